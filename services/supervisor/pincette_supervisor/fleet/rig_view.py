"""State of a rig, assembled for REST."""

from datetime import UTC, datetime

from msgspec.structs import asdict

from pincette.api.job_kinds import job_kinds
from pincette.api.rig_states import MOTION
from pincette.api.rigs import (
    ExchangeTimes,
    InstrumentCounts,
    Latch,
    LimitValue,
    ModelInUse,
    Newest,
    Program,
    Queue,
    Rig,
    RigAction,
    SafeToMove,
)
from pincette.core.faults import FaultCode, Mode
from pincette.core.messages import Applied, Estimate, Position, Status, Telemetry
from pincette.core.messages.arms import ArmEstimate
from pincette.core.topics import LOOP, TOPICS
from pincette.core.wording import status_text
from pincette_supervisor.alarms import fault_views
from pincette_supervisor.jobs import job_queue
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.jobs.refusals import readiness
from pincette_supervisor.rigs.health import PROGRAMS
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.watch import of_rig

SAMPLE_OF = {topic.producer: topic.message for topic in reversed(TOPICS) if topic.producer in LOOP}


def rig_view(manager: JobManager) -> Rig:
    """Return the rig's state; queries the programs unless they have just replied or a job runs."""
    context, queue = manager.context, manager.queue
    active, status = manager.active, None
    if active is not None:
        status = active.status
    if status is not None and status.over:
        active = status = None  # a new job is accepted, see ``await_end``
    health, rig = context.health, context.rig
    if status is None or status.terminal:
        health.refresh()
    found = readiness(context, status)
    stands = found.standing
    reason = found.latched or health.latch().reason
    reasons = [*found.faults, *filter(None, [found.actuator_unknown, found.taken])]
    startable = [
        name
        for name, kind in job_kinds().items()
        if len(rig.arms) in kind.arms and found.may_start(begins_held=kind.begins_held)
    ]
    return Rig(
        name=rig.rig.name,
        time=rig.rig.time,
        period_s=rig.rig.period_s,
        arms=len(rig.arms),
        digest=context.digest,
        model=ModelInUse(**context.model.in_use.stamp),
        programs=[_program(context, name) for name in PROGRAMS],
        checks=of_rig(context, active),
        limits=_limits(context),
        latch=Latch(
            state=stands.state,
            cause=str(reason.cause),
            faults=fault_views(reason.faults),
            words=context.trip_words(reason),
            clear=f"POST /api/v1/rigs/{rig.rig.name}/reset" if _resettable(context) else "",
        ),
        newest=_newest(context),
        part=stands.part,
        standing=stands,
        safe_to_move=SafeToMove(
            value=MOTION[found.motion].may_move,
            state=found.motion,
            reasons=[found.unsafe] if found.unsafe else [],
        ),
        use=context.use.newest(datetime.now(UTC)),
        claim=manager.claims.current(),
        active_job=None if active is None else active.id,
        queue=Queue(
            length=len(queue),
            halted=queue.halted,
            capacity=job_queue.CAPACITY,
            proposed=len(manager.proposals),
        ),
        can_start=not reasons,
        startable=startable,
        reasons=reasons,
        warnings=[*context.model.warnings(datetime.now(UTC)), *context.use.reasons()],
        allowed_actions=_actions(manager, startable),
    )


def _resettable(context: RigContext) -> bool:
    return context.health.latched() is not None or context.health.latch().mode == Mode.FROZEN


def _actions(manager: JobManager, startable: list[str]) -> list[RigAction]:
    actions: list[RigAction] = ["start_job", "estop"] if startable else ["estop"]
    if _resettable(manager.context):
        actions.append("reset")
    if manager.queue.halted:
        actions.append("resume_queue")
    if len(manager.queue):
        actions.append("clear_queue")
    return actions


def _program(context: RigContext, name: str) -> Program:
    status = context.health.status(name)
    return Program(
        name=name,
        alive=context.observer.alive(name),
        version=None if status is None else status.version,
        age_s=context.observer.age_s(SAMPLE_OF[name]) if name in SAMPLE_OF else None,
        epoch=None if status is None else status.epoch,
        missed=None if status is None else status.missed,
        refused=None if status is None else status.refused,
        instrument=None if status is None else _instrument_counts(status),
        exchanges=[] if status is None else _exchanges(status),
        detail="" if status is None else status_text(status),
        faults=[] if status is None else fault_views((*status.faults, *status.findings)),
        trouble=context.health.troubles().get(name, ""),
    )


def _exchanges(status: Status) -> list[ExchangeTimes]:
    return [ExchangeTimes.model_validate(asdict(one)) for one in status.exchanges]


def _instrument_counts(status: Status) -> InstrumentCounts | None:
    counts = status.instrument
    return None if counts is None else InstrumentCounts.model_validate(asdict(counts))


def _limits(context: RigContext) -> list[LimitValue]:
    limits = context.rig.limits
    return [
        LimitValue(quantity="voltage_min", value=limits.voltage_min_V, unit="V"),
        LimitValue(quantity="voltage_max", value=limits.voltage_max_V, unit="V"),
        LimitValue(quantity="slew", value=limits.slew_V_per_s, unit="V/s"),
        LimitValue(quantity="position_min", value=limits.position_min_um, unit="µm"),
        LimitValue(quantity="position_max", value=limits.position_max_um, unit="µm"),
        LimitValue(quantity="force_max", value=limits.force_max_mN, unit="mN"),
    ]


def _newest(context: RigContext) -> Newest | None:
    observer = context.observer
    position, estimate = observer.newest(Position), observer.newest(Estimate)
    telemetry, applied = observer.newest(Telemetry), observer.newest(Applied)
    if position is None and applied is None:
        return None
    # Without a zero the estimate has no reference, and no interface may pass it on as a force.
    known = estimate if estimate is not None and estimate.valid else None
    zeroed = _zeroed(known, 0)
    return Newest(
        seq=None if position is None else position.seq,
        phase=telemetry.phase if telemetry is not None and telemetry.playing else "",
        x_um=None if position is None else _x_um(position, 0),
        force_mN=None if zeroed is None else zeroed.force_mN,
        force_uncertainty_mN=None if zeroed is None else zeroed.force_uncertainty_mN,
        zero_age_s=None if zeroed is None else zeroed.zero_age_s,
        zero_invalid=any(
            arm.zero_refusal is not None and arm.zero_refusal.code == FaultCode.ZERO_INVALID
            for arm in (() if estimate is None else estimate.arms)
        ),
        voltage_V=None if applied is None else applied.confirmed_V(),
        **_newest_of_second(position, known, applied),
    )


def _x_um(position: Position, arm: int) -> float | None:
    """Return the position of an arm, in µm; None if it was not measured."""
    measured = position.arms[arm]
    return measured.x_um if measured.valid else None


def _zeroed(known: Estimate | None, arm: int) -> ArmEstimate | None:
    """Return the estimate of an arm whose force has a zero; None without one."""
    if known is None or arm >= len(known.arms) or known.arms[arm].zero_age_s is None:
        return None
    return known.arms[arm]


def _newest_of_second(
    position: Position | None, known: Estimate | None, applied: Applied | None
) -> dict[str, float | None]:
    """Return the newest values of the second arm; empty for a rig without one."""
    found: dict[str, float | None] = {}
    if position is not None and len(position.arms) > 1:
        found["second_x_um"] = _x_um(position, 1)
    if (zeroed := _zeroed(known, 1)) is not None:
        found["second_force_mN"] = zeroed.force_mN
    if applied is not None and len(applied.arms) > 1:
        found["second_voltage_V"] = applied.confirmed_V(1)
    return found
