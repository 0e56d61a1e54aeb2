"""Checks of a rig and of the supervisor, and the alarms that follow from them.

Each check is computed from known values only. One thread monitors each rig, with or without a job.
"""

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

from pincette.api.checks import Check
from pincette.core.faults import AT_REST, Cause, Fault, FaultCode
from pincette.core.messages import Applied, Estimate, Lease, Position, Telemetry
from pincette.core.topics import LOOP
from pincette.core.wording import fault_text, status_text
from pincette.engine.threads import RepeatedAction
from pincette_supervisor.journal.events import Severity
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.rigs.health import PROGRAMS, SIMULATION
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.rigs.standing import is_playing

SAMPLES = {"estimator": Estimate, "controller": Telemetry}
"""Programs that publish samples while a program is played."""
TOKENS = (*LOOP, "recorder", "rig")
"""Programs whose liveliness token is monitored."""
CLOCK = "clock"
"""Cause of the alarm of a step of the time of day; acknowledging it accepts the step."""
FRESH_S = 1.0
"""Age above which an estimate says nothing about the sensor, in s."""
MB = 1e6


class LeaseRenewal(Protocol):
    """Thread that renews the lease of a job's program."""

    @property
    def lease(self) -> Lease:
        """Return the lease that is renewed."""
        ...

    @property
    def age_s(self) -> float:
        """Return the time since the last renewal, in s."""
        ...


class ActiveJob(Protocol):
    """The job that occupies the rig, with the data that checks and alarms need."""

    @property
    def id(self) -> str:
        """Return the identifier of the job."""
        ...

    @property
    def epoch(self) -> int | None:
        """Return the epoch of the job's arming; None before it."""
        ...

    @property
    def renewal(self) -> LeaseRenewal | None:
        """Return the renewal of the lease of its program; None if there is no lease."""
        ...


def of_supervisor(store: Store) -> list[Check]:
    """Return the checks of the supervisor itself that apply to every rig."""
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
        _zero(context),
        *_forces(context),
        _lease(context, active),
        *_model(context),
    ]


def words_of(checks: list[Check]) -> list[str]:
    """Return the messages of needed checks that fail."""
    return [check.words for check in checks if check.needed and not check.ok]


def _check(name: str, ok: bool, words: str, *, needed: bool = True, **known: object) -> Check:
    base = {"value": None, "limit": None, "unit": "", "age_s": 0.0}
    return Check.model_validate(
        {"name": name, "ok": ok, "needed": needed, "words": words, **base, **known}
    )


def _answers(context: RigContext) -> Iterator[Check]:
    """Yield a check that each program replies, and works with the same rig file."""
    health = context.health
    troubles = health.troubles()
    for program in PROGRAMS:
        answer = health.status(program)
        trouble = troubles.get(program, "")
        if program == "sensor" and answer is not None and trouble == _sensor(context):
            trouble = ""  # the reason refers to its samples, not to its reply
        if answer is not None and not trouble:
            words = f"{program} answers, version {answer.version}"
        else:
            words = f"{program}: {trouble or 'has not been queried yet'}"
        yield _check(
            f"{program}.answer",
            answer is not None and not trouble,
            words,
            value=None if answer is None else answer.digest,
            limit=context.digest,
            age_s=health.asked_age_s,
        )


def _ages(context: RigContext) -> Iterator[Check]:
    """Yield checks of the age of the newest samples in real time; except for the sensor, only
    while a program plays."""
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
    """Return the check of the latch; a latched actuator passes, since it only waits for a
    person."""
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
    shown = "free space unknown" if free_MB is None else f"{free_MB:.0f} MB free"
    words = f"disk of {context.records}: {shown}, limit {limit_MB:g} MB"
    return _check("disk", ok, words, needed=False, value=free_MB, limit=limit_MB, unit="MB")


def _recorder(context: RigContext) -> Check:
    answer = context.health.status("recorder")
    lost = None if answer is None else answer.missed
    words = "recorder does not answer"
    if answer is not None:
        # The status text mentions lost messages only if there are some.
        none = "" if lost else "; no message was lost"
        words = f"recorder: {status_text(answer) or 'idle'}{none}"
    return _check(
        "recorder.lost", lost == 0, words, needed=False, value=lost, limit=0, unit="messages"
    )


def _refused(context: RigContext) -> Check:
    """Return the check that no program has recently rejected messages.

    The supervisor itself counts as a program; the check covers the last minute.
    """
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
    """Return the check that the estimator has followed the whole voltage history of the arm."""
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
    """Return the check that the arm's stroke is that of its calibration."""
    found = context.health.findings("estimator", FaultCode.MODEL_MISMATCH)
    words = "no change of the arm's stroke was found"
    return _finding("estimator.stroke", found, words, "change_percent", "limit_percent", "%")


def _zero(context: RigContext) -> Check:
    """Return the check that no zero of the force has become invalid."""
    found = context.health.findings("estimator", FaultCode.ZERO_INVALID)
    words = "no zero of the force was found to be invalid"
    return _finding("estimator.zero", found, words, "pull_mN", "uncertainty_mN", "mN")


def _forces(context: RigContext) -> Iterator[Check]:
    """Yield the check that the two forces of two arms on a held part agree."""
    if context.rig.second is not None:
        found = context.health.findings("estimator", FaultCode.FORCES_DISAGREE)
        words = "the forces of both arms agree"
        yield _finding("estimator.forces", found, words, "difference_mN", "uncertainty_mN", "mN")


def _finding(
    name: str, found: Sequence[Fault], words: str, value: str, limit: str, unit: str
) -> Check:
    """Return a check that fails with a fault, including two of the fault's values."""
    numbers = {one.name: one.value for one in found[0].values} if found else {}
    return _check(
        name,
        not found,
        fault_text(found[0]) if found else words,
        needed=False,
        value=numbers.get(value),
        limit=numbers.get(limit),
        unit=unit,
    )


def _lease(context: RigContext, active: ActiveJob | None) -> Check:
    renewal = None if active is None else active.renewal
    if renewal is None:
        limit_s = context.rig.safety.lease_s if not context.rig.lockstep else 0.0
        return _check(
            "lease", True, "no motion program runs under a lease", limit=limit_s, unit="s"
        )
    age_s, limit_s = renewal.age_s, renewal.lease.length_s
    words = f"lease renewed {age_s:.1f} s ago, limit {limit_s:g} s"
    return _check("lease", age_s <= limit_s, words, value=age_s, limit=limit_s, unit="s")


def _model(context: RigContext) -> Iterator[Check]:
    warnings = context.model.warnings(datetime.now(UTC))
    words = "; ".join(warnings) or "no calibration is due"
    yield _check("model.due", not warnings, words, needed=False, value=len(warnings), limit=0)
    reasons, words = context.use.reasons(), context.use.words()
    yield _check(
        "calibration.use",
        not reasons,
        "; ".join(reasons) or words,
        needed=False,
        value=len(reasons),
        limit=0,
    )
    if context.model.trouble:
        yield _check("model", False, context.model.trouble)


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition that raises an alarm as long as it lasts."""

    cause: str
    words: str
    severity: Severity = "alarm"


def conditions(context: RigContext) -> Iterator[Condition]:
    """Yield all present conditions of a rig that raise an alarm."""
    gone = context.observer.gone(TOKENS)
    for program in gone:
        yield Condition(
            f"program.{program}", f"{program} has disappeared: killed, hung or disconnected"
        )
    if "sensor" not in gone:
        yield from _sensor_conditions(context)
    yield from _zero_conditions(context)
    disk = _disk(context)
    if not disk.ok:
        yield Condition(disk.name, disk.words, "warning")
    for check in of_supervisor(context.store):
        if not check.ok:
            yield Condition(check.name, check.words)
    if due := [*context.model.overdue(datetime.now(UTC)), *context.use.reasons()]:
        yield Condition("calibration.due", "; ".join(due), "warning")
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


def _zero_conditions(context: RigContext) -> Iterator[Condition]:
    """Yield the condition that the zero of an arm's force is invalid, until a new zero."""
    estimate = context.observer.newest(Estimate)
    for arm in () if estimate is None else estimate.arms:
        if arm.zero_refusal is not None and arm.zero_refusal.code == FaultCode.ZERO_INVALID:
            yield Condition("estimator.zero", fault_text(arm.zero_refusal), "warning")


def free_space_MB(folder: Path) -> float | None:
    """Return the free space in MB on the disk of a folder, which may not exist yet.

    None: unknown.
    """
    for place in (folder, *folder.parents):
        if place.exists():
            try:
                return shutil.disk_usage(place).free / MB
            except OSError:
                return None
    return None


LOOK_S, ASK_S = 0.25, 2.0
"""Interval of the checks, and of the status requests to the programs of a rig in real time, in
s."""
IDLE_S = 10.0
"""Time in s for which the actuator must have been at rest without a job before the sensor is set to
its slow rate.
"""
JOIN_S = 2.0
REFUSED, REFUSED_S = 5, 1.0
"""Number of rejected commands within a time in s from which an alarm is raised; an arming causes
fewer.
"""
MISSED_SHARE, MISSED_S = 0.01, 10.0
"""Fraction of the ticks within a time in s that may be missed without an alarm."""
FOREIGN = frozenset({FaultCode.OTHER_OWNER, FaultCode.SECOND_CONTROLLER})
"""Reasons of rejection that mean that the command came from another controller."""
AFTER_A_LOSS = (
    "the job's result is complete, but its record is not; record_detail states what is "
    "missing. Check what else uses disk and processors, and repeat the job if its record is "
    "needed"
)


@dataclass(slots=True)
class GrowthDetector:
    """Detects growth of a counter beyond a limit; a smaller value indicates a restart."""

    limit: int
    """Growth within ``window_s`` that is reported."""
    window_s: float
    _last: int | None = None
    _since_s: float = 0.0
    _grown: int = 0

    def update(self, value: int, now_s: float) -> int:
        """Add a value; return the growth once it has reached the limit, otherwise 0."""
        last, self._last = self._last, value
        if last is None or value < last:
            self._since_s, self._grown = now_s, 0
            return 0
        if now_s - self._since_s > self.window_s:
            self._since_s, self._grown = now_s, 0
        self._grown += value - last
        if self._grown < self.limit:
            return 0
        grown, self._grown, self._since_s = self._grown, 0, now_s
        return grown


class AlarmMonitor:
    """Raises and clears alarms from known values; queries the programs only rarely."""

    def __init__(self, context: RigContext, active: Callable[[], ActiveJob | None]) -> None:
        self._context, self._active = context, active
        self._conditions: dict[str, Condition] = {}
        self._known = False
        """True once the alarms of an earlier supervisor have been looked up."""
        self._tripped = False
        self._asked_s = self._busy_s = float("-inf")
        missed = max(1, round(MISSED_SHARE * MISSED_S / context.rig.rig.period_s))
        self._refused = GrowthDetector(REFUSED, REFUSED_S)
        self._missed = GrowthDetector(missed, MISSED_S)
        self._lost = GrowthDetector(1, REFUSED_S)
        self._repeated = RepeatedAction(f"alarms-{context.rig.rig.name}", LOOK_S, self.poll)

    def start(self) -> None:
        """Start polling in a thread."""
        self._repeated.start()

    def close(self) -> None:
        """Stop polling."""
        self._repeated.close(JOIN_S)

    def poll(self) -> None:
        """Compare the present conditions with the previous ones, once."""
        context = self._context
        if context.write_queue.flush() and context.store.trouble:
            context.store.probe()
        self._poll_trip()
        self._poll_conditions()
        self._poll_refusals()
        if not context.rig.lockstep:  # in lockstep programs may take any time
            self._ask()

    def _poll_trip(self) -> None:
        context = self._context
        trip = context.observer.trips.newest
        if trip is None or trip.reason.cause == Cause.BOOT:
            if self._tripped:
                self._tripped = False
                context.alarms.reset()
            return
        self._tripped = True
        live = self._active()
        job = live.id if live is not None and live.epoch == trip.epoch else None
        context.alarms.raise_trip(trip.reason, context.trip_words(trip.reason), job)

    def _poll_conditions(self) -> None:
        alarms = self._context.alarms
        found = {one.cause: one for one in conditions(self._context)}
        for cause, one in found.items():
            if cause not in self._conditions:
                alarms.raise_alarm(cause, one.words, severity=one.severity, job=self._job())
        for cause, one in self._previous_conditions().items():
            if cause not in found:
                alarms.clear(cause, f"ended: {one.words}")
        self._conditions = found

    def _previous_conditions(self) -> dict[str, Condition]:
        """Return the conditions of the last poll.

        At the first poll, return those that an earlier supervisor has raised.
        """
        if self._known:
            return self._conditions
        try:
            rows = self._context.alarms.open_conditions()
        except StoreError:
            return self._conditions
        self._known = True
        left = {row.cause: Condition(row.cause, row.words) for row in rows}
        return {**left, **self._conditions}

    def _poll_refusals(self) -> None:
        applied = self._context.observer.newest(Applied)
        if applied is None:
            return
        count = self._refused.update(applied.refused, self._context.clock())
        if not count:
            return
        self._context.health.refresh(force=True)
        status = self._context.health.status("actuator")
        foreign = status is not None and any(one.code in FOREIGN for one in status.findings)
        cause = "controller.second" if foreign else "actuator.refused"
        detail = "" if status is None else status_text(status)
        words = f"actuator refused {count} commands, limit {REFUSED} in {REFUSED_S:g} s; {detail}"
        self._raise_transient(cause, words)

    def _ask(self) -> None:
        """Request the counters of the programs."""
        context = self._context
        now_s = context.clock()
        if now_s - self._asked_s < ASK_S:
            return
        self._asked_s = now_s
        context.health.refresh()
        self._let_idle(now_s)
        sensor, recorder = context.health.status("sensor"), context.health.status("recorder")
        if sensor is not None and (missed := self._missed.update(sensor.missed, now_s)):
            limit = f"{100.0 * MISSED_SHARE:g} % of the ticks in {MISSED_S:g} s"
            self._raise_transient("ticks.missed", f"sensor missed {missed} ticks, limit {limit}")
        if recorder is not None and (lost := self._lost.update(recorder.missed, now_s)):
            self._raise_transient(
                "recorder.lost",
                f"recorder lost {lost} messages: {status_text(recorder)}; {AFTER_A_LOSS}",
            )

    def _let_idle(self, now_s: float) -> None:
        """Set the sensor to its slow rate after the rig has been at rest without a job for
        ``IDLE_S``.
        """
        actuator = self._context.health.status("actuator")
        at_rest = actuator is not None and actuator.mode in AT_REST
        if not at_rest or self._active() is not None or self._busy_s == float("-inf"):
            self._busy_s = now_s
        elif now_s - self._busy_s >= IDLE_S:
            self._context.health.reduce_sampling()

    def _raise_transient(self, cause: str, words: str) -> None:
        self._context.alarms.raise_alarm(
            cause, words, severity="warning", clears="acknowledge", job=self._job()
        )

    def _job(self) -> str | None:
        live = self._active()
        return None if live is None else live.id
