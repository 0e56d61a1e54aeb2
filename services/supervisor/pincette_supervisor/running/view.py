"""What is known of the rig, put together for REST."""

from typing import Literal, cast

from pincette.api.rig_models import (
    Interlock,
    Latch,
    LimitValue,
    ModelInUse,
    Newest,
    Program,
    Rig,
    RigAction,
)
from pincette.messages import Applied, Estimate, Position, Status, Telemetry
from pincette.topics import APPLIED, ESTIMATE, LOOP, POSITION, TELEMETRY, TOPICS
from pincette_supervisor.running.job import LiveJob
from pincette_supervisor.running.site import Site

TOPIC_OF_PROGRAM = {topic.producer: topic for topic in reversed(TOPICS) if topic.producer in LOOP}
PLAYING_S = 1.0


def rig_view(site: Site, active: LiveJob | None) -> Rig:
    """The rig as it is; asks the programs unless they have just answered or a job runs."""
    health, rig = site.health, site.rig
    if active is None or active.terminal:
        health.refresh()
    state, cause = health.latch()
    latched = health.latched()
    reasons = site.reasons()
    if latched:
        reasons.append(f"actuator: latched ({latched}); reset it once the cause is gone")
    if active is not None:
        doing = "holds a part" if active.terminal else f"is {active.state}"
        reasons.append(f"job {active.id} {doing}")
    elif _foreign(site, state):
        reasons.append("actuator: armed for another program than a job of this supervisor")
    actions: list[RigAction] = ["estop"] if reasons else ["start_job", "estop"]
    if latched:
        actions.append("reset")
    return Rig(
        name=rig.rig.name,
        time=rig.rig.time,
        period_s=rig.rig.period_s,
        digest=site.digest,
        model=ModelInUse(**site.model.in_use.stamp),
        programs=[_program(site, name) for name in LOOP],
        interlocks=_interlocks(site, latched),
        limits=_limits(site),
        latch=Latch(
            state=state,
            cause=latched or cause,
            clear=f"POST /api/v1/rigs/{rig.rig.name}/reset" if latched else "",
        ),
        newest=_newest(site),
        part=_part(site, state),
        active_job=None if active is None else active.id,
        can_start=not reasons,
        reasons=reasons,
        allowed_actions=actions,
    )


def _foreign(site: Site, state: str) -> bool:
    age_s = site.observer.age_s(APPLIED)
    return state == "armed" and age_s is not None and age_s < PLAYING_S


def _program(site: Site, name: str) -> Program:
    answer = site.health.statuses.get(name)
    status = answer if isinstance(answer, Status) else None
    return Program(
        name=name,
        alive=site.observer.alive(name),
        version=None if status is None else status.version,
        age_s=site.observer.age_s(TOPIC_OF_PROGRAM[name]),
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
        age_s, limit_s = site.observer.age_s(POSITION), health.sensor_limit_s()
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


def _part(site: Site, state: str) -> Literal["none", "held", "unknown"]:
    applied = cast("Applied | None", site.observer.newest(APPLIED))
    if applied is None or state in ("unknown", "ramping", "latched"):
        return "unknown"
    return "held" if applied.part_held else "none"
