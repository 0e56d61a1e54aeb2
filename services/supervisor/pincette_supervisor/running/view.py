"""What is known of the rig, put together for REST."""

from datetime import UTC, datetime
from typing import cast, get_args

from pincette.api.job_models import JobKind
from pincette.api.rig_models import (
    Interlock,
    Latch,
    LimitValue,
    ModelInUse,
    Newest,
    Program,
    Queue,
    Rig,
    RigAction,
)
from pincette.messages import Applied, Estimate, Position, Status, Telemetry
from pincette.topics import APPLIED, ESTIMATE, LOOP, POSITION, TELEMETRY, TOPICS
from pincette_supervisor.running import job_queue
from pincette_supervisor.running.checks import of_rig
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.health import PROGRAMS
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.part import held_words, part, plays
from pincette_supervisor.running.safe_to_move import safe_to_move
from pincette_supervisor.running.site import Site

TOPIC_OF_PROGRAM = {topic.producer: topic for topic in reversed(TOPICS) if topic.producer in LOOP}
KINDS: tuple[JobKind, ...] = get_args(JobKind)
HOLDING: tuple[JobKind, ...] = ("hold", "release")
"""Jobs that may begin with a part in the gripper."""


def rig_view(conductor: Conductor) -> Rig:
    """The rig as it is; asks the programs unless they have just answered or a job runs."""
    site, active, queue = conductor.site, conductor.active, conductor.queue
    health, rig = site.health, site.rig
    if active is None or active.terminal:
        health.refresh()
    state, cause = health.latch()
    latched = health.latched()
    faults = site.reasons()
    if latched:
        words = site.trip_words(latched)
        faults.append(f"actuator: latched ({words}); reset it once the cause is gone")
    reasons = [*faults, *_taken(site, active)]
    startable = [] if faults else _startable(site, active)
    return Rig(
        name=rig.rig.name,
        time=rig.rig.time,
        period_s=rig.rig.period_s,
        digest=site.digest,
        model=ModelInUse(**site.model.in_use.stamp),
        programs=[_program(site, name) for name in PROGRAMS],
        checks=of_rig(site, active),
        interlocks=_interlocks(site, latched),
        limits=_limits(site),
        latch=Latch(
            state=state,
            cause=latched or cause,
            words=site.trip_words(latched or cause),
            clear=f"POST /api/v1/rigs/{rig.rig.name}/reset" if _resettable(site) else "",
        ),
        newest=_newest(site),
        part=part(site),
        safe_to_move=safe_to_move(site, active),
        active_job=None if active is None else active.id,
        queue=Queue(length=len(queue), halted=queue.halted, capacity=job_queue.CAPACITY),
        can_start=not reasons,
        startable=startable,
        reasons=reasons,
        warnings=_warnings(site),
        allowed_actions=_actions(conductor, startable),
    )


def _taken(site: Site, active: LiveJob | None) -> list[str]:
    """Who has the rig, or the part that is in the gripper."""
    if active is not None:
        doing = "holds a part" if active.terminal else f"is {active.state}"
        return [f"job {active.id} {doing}"]
    words = held_words(site)
    if words:
        return [words]
    if plays(site):
        return ["actuator: armed for another program than a job of this supervisor"]
    return []


def _startable(site: Site, active: LiveJob | None) -> list[JobKind]:
    """Kinds of job that can start while no program has a fault."""
    if active is not None:
        return [*HOLDING] if active.terminal and active.held else []
    if part(site) == "held":
        return [*HOLDING]
    return [] if plays(site) else [*KINDS]


def _resettable(site: Site) -> bool:
    return bool(site.health.latched()) or site.health.latch()[0] == "frozen"


def _actions(conductor: Conductor, startable: list[JobKind]) -> list[RigAction]:
    actions: list[RigAction] = ["start_job", "estop"] if startable else ["estop"]
    if _resettable(conductor.site):
        actions.append("reset")
    if conductor.queue.halted:
        actions.append("resume_queue")
    if len(conductor.queue):
        actions.append("clear_queue")
    return actions


def _warnings(site: Site) -> list[str]:
    return site.model.warnings(datetime.now(UTC))


def _program(site: Site, name: str) -> Program:
    answer = site.health.statuses.get(name)
    status = answer if isinstance(answer, Status) else None
    return Program(
        name=name,
        alive=site.observer.alive(name),
        version=None if status is None else status.version,
        age_s=site.observer.age_s(TOPIC_OF_PROGRAM[name]) if name in TOPIC_OF_PROGRAM else None,
        epoch=None if status is None else status.epoch,
        missed=None if status is None else status.missed,
        refused=None if status is None else status.refused,
        detail="" if status is None else status.detail,
        trouble=site.health.troubles().get(name, ""),
    )


def _interlocks(site: Site, latched: str) -> list[Interlock]:
    health = site.health
    digest = site.digest
    found: list[Interlock] = []
    for name, answer in health.statuses.items():
        status = answer if isinstance(answer, Status) else None
        found.append(
            Interlock(
                name=f"{name}_rig_file",
                satisfied=status is not None and status.digest == digest,
                value=None if status is None else status.digest,
                limit=digest,
                unit="",
            )
        )
    if not site.rig.lockstep:
        age_s, limit_s = site.observer.silent_s(POSITION), health.sensor_limit_s()
        satisfied = age_s is not None and age_s <= limit_s
        found.append(
            Interlock(name="sensor_age", satisfied=satisfied, value=age_s, limit=limit_s, unit="s")
        )
    found.append(
        Interlock(
            name="actuator_latch",
            satisfied=not latched,
            value=latched or "clear",
            limit="clear",
            unit="",
        )
    )
    return found


def _limits(site: Site) -> list[LimitValue]:
    limits = site.rig.limits
    return [
        LimitValue(quantity="voltage_min", value=limits.voltage_min_V, unit="V"),
        LimitValue(quantity="voltage_max", value=limits.voltage_max_V, unit="V"),
        LimitValue(quantity="slew", value=limits.slew_V_per_s, unit="V/s"),
        LimitValue(quantity="position_min", value=limits.position_min_um, unit="µm"),
        LimitValue(quantity="position_max", value=limits.position_max_um, unit="µm"),
        LimitValue(quantity="force_max", value=limits.force_max_mN, unit="mN"),
    ]


def _newest(site: Site) -> Newest | None:
    observer = site.observer
    position = cast("Position | None", observer.newest(POSITION))
    estimate = cast("Estimate | None", observer.newest(ESTIMATE))
    telemetry = cast("Telemetry | None", observer.newest(TELEMETRY))
    applied = cast("Applied | None", observer.newest(APPLIED))
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
    )
