"""Checks of a rig and of the supervisor, and alarm conditions, from known values alone."""

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

from pincette.api.checks import Check
from pincette.core.faults import Fault, FaultCode
from pincette.core.messages import Estimate, Lease, Position, Telemetry
from pincette.core.topics import LOOP
from pincette.core.wording import fault_text, status_text
from pincette_supervisor.journal.alarm_rows import Severity
from pincette_supervisor.journal.store import Store
from pincette_supervisor.rigs.health import PROGRAMS, SIMULATION
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import is_playing

SAMPLES = {"estimator": Estimate, "controller": Telemetry}
"""Programs whose samples come while a program plays."""
TOKENS = (*LOOP, "recorder", "rig")
"""Programs whose liveliness token is watched."""
CLOCK = "clock"
"""Cause of the alarm of a step of the time of day; to acknowledge it is to agree to the step."""
FRESH_S = 1.0
"""An older estimate says nothing of the sensor any more."""
MB = 1e6


class LeaseRenewal(Protocol):
    """The thread that renews the lease of a job's program."""

    @property
    def lease(self) -> Lease:
        """The lease that it renews."""
        ...

    @property
    def age_s(self) -> float:
        """Time since the last renewal, in s."""
        ...


class ActiveJob(Protocol):
    """The job that has the rig, as far as checks and alarms need it."""

    @property
    def id(self) -> str:
        """Identifier of the job."""
        ...

    @property
    def epoch(self) -> int | None:
        """Epoch of its arming; None before it."""
        ...

    @property
    def renewal(self) -> LeaseRenewal | None:
        """Renews the lease of its program; None where there is no lease."""
        ...


def of_supervisor(store: Store) -> list[Check]:
    """Return what every rig needs of the supervisor itself."""
    words = store.trouble or "the journal can be written"
    value = "failed" if store.trouble else "written"
    return [
        _check("store", not store.trouble, words, value=value, limit="written"),
        *(
            _check(cause, False, trouble, needed=False, value="failed", limit="well")
            for cause, trouble in sorted(store.troubles.items())
        ),
    ]


def of_rig(context: RigContext, active: ActiveJob | None) -> list[Check]:
    """Return all checks of a rig, in the order of a tick."""
    return [
        *_answers(context),
        *_ages(context),
        _latch(context),
        _disk(context),
        _recorder(context),
        _refused(context),
        _memory(context),
        _stroke(context),
        *_forces(context),
        _lease(context, active),
        *_model(context),
    ]


def words_of(checks: list[Check]) -> list[str]:
    """Return what is needed and missing."""
    return [check.words for check in checks if check.needed and not check.ok]


def _check(name: str, ok: bool, words: str, *, needed: bool = True, **known: object) -> Check:
    base = {"value": None, "limit": None, "unit": "", "age_s": 0.0}
    return Check.model_validate(
        {"name": name, "ok": ok, "needed": needed, "words": words, **base, **known}
    )


def _answers(context: RigContext) -> Iterator[Check]:
    """Yield whether each program answers, and works with the same rig file."""
    health = context.health
    troubles = health.troubles()
    for program in PROGRAMS:
        answer = health.status(program)
        trouble = troubles.get(program, "")
        if program == "sensor" and answer is not None and trouble == _sensor(context):
            trouble = ""  # of its samples, not of its answer
        if answer is not None and not trouble:
            words = f"{program} answers, version {answer.version}"
        else:
            words = f"{program}: {trouble or 'was not asked yet'}"
        yield _check(
            f"{program}.answer",
            answer is not None and not trouble,
            words,
            value=None if answer is None else answer.digest,
            limit=context.digest,
            age_s=health.asked_age_s,
        )


def _ages(context: RigContext) -> Iterator[Check]:
    """In real time, how old the newest samples are; the sensor's always, others' in a program."""
    if context.rig.lockstep:
        return
    limit_s = context.health.sensor_limit_s()
    age_s = context.observer.silent_s(Position)
    trouble = _sensor(context)
    words = f"sensor: {trouble}" if trouble else "the sensor's samples come"
    yield _check("sensor.age", not trouble, words, value=age_s, limit=limit_s, unit="s")
    for program, kind in SAMPLES.items() if is_playing(context) else ():
        age_s = context.observer.silent_s(kind)
        ok = age_s is not None and age_s <= limit_s
        words = f"the {program}'s samples come"
        if age_s is None:
            words = f"{program}: no sample has come yet"
        elif not ok:
            words = f"{program}: silent for {1e3 * age_s:.0f} ms, limit {1e3 * limit_s:.0f} ms"
        yield _check(
            f"{program}.age", ok, words, needed=False, value=age_s, limit=limit_s, unit="s"
        )


def _sensor(context: RigContext) -> str:
    return "" if context.rig.lockstep else context.health.sensor_trouble()


def _latch(context: RigContext) -> Check:
    """Return a latched actuator is well, and waits for a person."""
    latched = context.health.latched()
    state = context.health.state
    words = "no latch to clear"
    if latched is not None:
        words = f"actuator latched ({context.trip_words(latched)})"
    elif state == "switched_on":
        words = "actuator at its safe voltage since it was switched on; the first job clears this"
    return _check(
        "actuator.latch",
        latched is None,
        words,
        needed=False,
        value=state if latched is None else context.health.latch().shown,
        limit="clear",
    )


def _disk(context: RigContext) -> Check:
    free_MB, limit_MB = free_space_MB(context.records), context.rig.recorder.min_free_MB
    ok = free_MB is None or free_MB >= limit_MB
    shown = "room is not known" if free_MB is None else f"{free_MB:.0f} MB free"
    words = f"disk of {context.records}: {shown}, limit {limit_MB:g} MB"
    return _check("disk", ok, words, needed=False, value=free_MB, limit=limit_MB, unit="MB")


def _recorder(context: RigContext) -> Check:
    answer = context.health.status("recorder")
    lost = None if answer is None else answer.missed
    words = "recorder does not answer"
    if answer is not None:
        # The status states how many messages were lost, unless there were none.
        none = "" if lost else "; no message was lost"
        words = f"recorder: {status_text(answer) or 'idle'}{none}"
    return _check(
        "recorder.lost", lost == 0, words, needed=False, value=lost, limit=0, unit="messages"
    )


def _refused(context: RigContext) -> Check:
    """Whether a program, this supervisor included, has refused messages in the last minute."""
    found = [
        (program, one)
        for program in (*PROGRAMS, SIMULATION)
        for one in context.health.findings(program, FaultCode.MESSAGES_REFUSED)
    ]
    if (own := context.bus.refused.finding()) is not None:
        found.append(("supervisor", own))
    words = "; ".join(f"{program}: {fault_text(one)}" for program, one in found)
    return _check(
        "bus.refused",
        not found,
        words or "no message was refused in the last minute",
        needed=False,
        value=len(found),
        limit=0,
        unit="programs",
    )


def _memory(context: RigContext) -> Check:
    """Return whether the estimator has followed all that the arm remembers."""
    answer = context.health.status("estimator")
    unknown = context.health.findings("estimator", FaultCode.MEMORY_UNKNOWN)
    words = "the arm's memory is known" if answer is not None else "estimator does not answer"
    return _check(
        "estimator.memory",
        answer is not None and not unknown,
        "; ".join(map(fault_text, unknown)) or words,
        needed=False,
        value="unknown" if unknown or answer is None else "known",
        limit="known",
    )


def _stroke(context: RigContext) -> Check:
    """Return the check that the stroke of the arm is that of its calibration."""
    found = context.health.findings("estimator", FaultCode.MODEL_MISMATCH)
    words = "no change of the arm's stroke was found"
    return _finding("estimator.stroke", found, words, "change_percent", "limit_percent", "%")


def _forces(context: RigContext) -> Iterator[Check]:
    """Of two arms, whether both forces on a held part agree."""
    if context.rig.second is not None:
        found = context.health.findings("estimator", FaultCode.FORCES_DISAGREE)
        words = "the forces of both arms agree"
        yield _finding("estimator.forces", found, words, "difference_mN", "uncertainty_mN", "mN")


def _finding(
    name: str, found: Sequence[Fault], words: str, value: str, limit: str, unit: str
) -> Check:
    """Return a check that fails by a finding, with two of the finding's values."""
    told = {one.name: one.value for one in found[0].values} if found else {}
    return _check(
        name,
        not found,
        fault_text(found[0]) if found else words,
        needed=False,
        value=told.get(value),
        limit=told.get(limit),
        unit=unit,
    )


def _lease(context: RigContext, active: ActiveJob | None) -> Check:
    renewal = None if active is None else active.renewal
    if renewal is None:
        limit_s = context.rig.safety.lease_s if not context.rig.lockstep else 0.0
        return _check("lease", True, "no program plays under a lease", limit=limit_s, unit="s")
    age_s, limit_s = renewal.age_s, renewal.lease.length_s
    words = f"lease renewed {age_s:.1f} s ago, limit {limit_s:g} s"
    return _check("lease", age_s <= limit_s, words, value=age_s, limit=limit_s, unit="s")


def _model(context: RigContext) -> Iterator[Check]:
    warnings = context.model.warnings(datetime.now(UTC))
    words = "; ".join(warnings) or "no calibration is due"
    yield _check("model.due", not warnings, words, needed=False, value=len(warnings), limit=0)
    if context.model.trouble:
        yield _check("model", False, context.model.trouble)


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition that raises an alarm for as long as it lasts."""

    cause: str
    words: str
    severity: Severity = "alarm"


def conditions(context: RigContext) -> Iterator[Condition]:
    """Yield all present conditions of a rig that raise an alarm."""
    gone = context.observer.gone(TOKENS)
    for program in gone:
        yield Condition(f"program.{program}", f"{program} has gone: killed, hung or cut off")
    if "sensor" not in gone:
        yield from _sensor_conditions(context)
    disk = _disk(context)
    if not disk.ok:
        yield Condition(disk.name, disk.words, "warning")
    for check in of_supervisor(context.store):
        if not check.ok:
            yield Condition(check.name, check.words)
    for stepped in context.health.findings("recorder", FaultCode.CLOCK_STEPPED):
        yield Condition(CLOCK, fault_text(stepped))


def _sensor_conditions(context: RigContext) -> Iterator[Condition]:
    observer = context.observer
    estimate = observer.newest(Estimate)
    age_s = observer.age_s(Estimate)
    fresh = age_s is not None and age_s < FRESH_S
    fault = estimate.fault if estimate is not None and fresh else None
    if fault is not None and fault.code is FaultCode.SENSOR_STUCK:
        yield Condition("sensor.stuck", fault_text(fault))
    elif not context.rig.lockstep and observer.age_s(Position) is not None:
        trouble = context.health.sensor_trouble()
        if trouble:
            yield Condition("sensor", f"sensor {trouble}")


def free_space_MB(folder: Path) -> float | None:
    """Room in MB on the disk of a folder, which may not be there yet; None where nobody knows."""
    for place in (folder, *folder.parents):
        if place.exists():
            try:
                return shutil.disk_usage(place).free / MB
            except OSError:
                return None
    return None
