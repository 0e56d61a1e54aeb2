"""What is known of the rig, put together for REST."""

from datetime import UTC, datetime

from msgspec import UNSET
from msgspec.structs import asdict

from pincette.api.job_kinds import job_kinds
from pincette.api.rig_states import RIG_STATES
from pincette.api.rigs import (
    ExchangeTimes,
    InstrumentCounts,
    Interlock,
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
from pincette.core.faults import Mode
from pincette.core.messages import Applied, Estimate, Position, Status, Telemetry
from pincette.core.topics import LOOP, TOPICS
from pincette.core.wording import status_text
from pincette_supervisor.alarms.checks import of_rig
from pincette_supervisor.alarms.trips import TripReason, fault_views
from pincette_supervisor.jobs import job_queue
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.rigs.health import PROGRAMS
from pincette_supervisor.rigs.part import held_words, is_playing, playing_words, unsafe_to_move
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import standing

SAMPLE_OF = {topic.producer: topic.message for topic in reversed(TOPICS) if topic.producer in LOOP}


def rig_view(manager: JobManager) -> Rig:
    """The rig; asks the programs unless they have just answered or a job runs."""
    context, queue = manager.context, manager.queue
    active = manager.active
    if active is not None and active.over:
        active = None  # a new job is accepted, see ``await_end``
    health, rig = context.health, context.rig
    if active is None or active.terminal:
        health.refresh()
    latch = health.latch()
    latched = health.latched()
    stands = standing(context)
    reason = latched or latch.reason
    faults = context.reasons()
    if latched is not None:
        words = context.trip_words(latched)
        faults.append(f"actuator: latched ({words}); reset it once the cause is gone")
    if not faults and not RIG_STATES[stands.state].may_start:
        entry = RIG_STATES[stands.state]
        faults.append(f"actuator: {stands.state}: {entry.meaning}; {entry.remedy}")
    reasons = [*faults, *_taken(context, active)]
    unsafe = unsafe_to_move(context, active)
    startable = [] if faults else _startable(context, active)
    return Rig(
        name=rig.rig.name,
        time=rig.rig.time,
        period_s=rig.rig.period_s,
        arms=len(rig.arms),
        digest=context.digest,
        model=ModelInUse(**context.model.in_use.stamp),
        programs=[_program(context, name) for name in PROGRAMS],
        checks=of_rig(context, active),
        interlocks=_interlocks(context, latched),
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
        safe_to_move=SafeToMove(value=not unsafe, reasons=[unsafe] if unsafe else []),
        claim=manager.claims.current(),
        active_job=None if active is None else active.id,
        queue=Queue(length=len(queue), halted=queue.halted, capacity=job_queue.CAPACITY),
        can_start=not reasons,
        startable=startable,
        reasons=reasons,
        warnings=context.model.warnings(datetime.now(UTC)),
        allowed_actions=_actions(manager, startable),
    )


def _taken(context: RigContext, active: LiveJob | None) -> list[str]:
    """Why the rig is taken: by a job, a held part, or another program."""
    if active is not None:
        doing = "holds a part" if active.terminal else f"is {active.state}"
        return [f"job {active.id} {doing}"]
    words = held_words(context) or playing_words(context)
    return [words] if words else []


def _startable(context: RigContext, active: LiveJob | None) -> list[str]:
    """Kinds of job that can start while no program has a fault."""
    arms = len(context.rig.arms)
    kinds = {name: kind for name, kind in job_kinds().items() if arms in kind.arms}
    holding = [kind.name for kind in kinds.values() if kind.begins_held]
    if active is not None:
        return holding if active.terminal and active.held else []
    part = standing(context).part
    if part == "held":
        return holding
    if is_playing(context):
        return []
    return [name for name in kinds if part == "unknown" or name not in holding]


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


def _interlocks(context: RigContext, latched: TripReason | None) -> list[Interlock]:
    health = context.health
    digest = context.digest
    found: list[Interlock] = []
    for name in health.statuses:
        status = health.status(name)
        found.append(
            Interlock(
                name=f"{name}_rig_file",
                satisfied=status is not None and status.digest == digest,
                value=None if status is None else status.digest,
                limit=digest,
                unit="",
            )
        )
    if not context.rig.lockstep:
        age_s, limit_s = context.observer.silent_s(Position), health.sensor_limit_s()
        satisfied = age_s is not None and age_s <= limit_s
        found.append(
            Interlock(name="sensor_age", satisfied=satisfied, value=age_s, limit=limit_s, unit="s")
        )
    found.append(
        Interlock(
            name="actuator_latch",
            satisfied=latched is None,
            value="clear" if latched is None else str(latched.cause),
            limit="clear",
            unit="",
        )
    )
    return found


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
    known = estimate if estimate is not None and estimate.valid else None
    return Newest(
        seq=None if position is None else position.seq,
        phase=telemetry.phase if telemetry is not None and telemetry.playing else "",
        x_um=position.x_um if position is not None and position.valid else None,
        force_mN=None if known is None else known.force_mN,
        force_uncertainty_mN=None if known is None else known.force_uncertainty_mN,
        zero_age_s=None if known is None else known.zero_age_s,
        voltage_V=None if applied is None else applied.voltage_V,
        **_newest_of_second(position, known, applied),
    )


def _newest_of_second(
    position: Position | None, known: Estimate | None, applied: Applied | None
) -> dict[str, float | None]:
    """The same of the second arm; nothing where there is none."""
    found: dict[str, float | None] = {}
    if position is not None and position.second is not UNSET:
        found["second_x_um"] = position.second.x_um if position.second.valid else None
    if known is not None and known.second is not UNSET:
        found["second_force_mN"] = known.second.force_mN
    if applied is not None and applied.second is not UNSET:
        found["second_voltage_V"] = applied.second.voltage_V
    return found
