"""Watches one rig for what an operator must learn, with a job or without; never inside the loop."""

from collections.abc import Callable
from dataclasses import dataclass

from pincette.core.faults import AT_REST, Cause, FaultCode
from pincette.core.messages import Applied
from pincette.core.wording import status_text
from pincette.engine.threads import RepeatedAction
from pincette_supervisor.journal.store import StoreError
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.watch.checks import ActiveJob, Condition, conditions

LOOK_S, ASK_S = 0.25, 2.0
"""Between two looks, and between two questions to the programs of a rig in real time."""
IDLE_S = 10.0
"""Time without a job at rest after which the sensor is asked to sample seldom."""
JOIN_S = 2.0
REFUSED, REFUSED_S = 5, 1.0
"""Number of refused commands, and the time, beyond which they are no accident of an arming."""
MISSED_SHARE, MISSED_S = 0.01, 10.0
"""Share of the ticks that may be missed within a while."""
FOREIGN = frozenset({FaultCode.OTHER_OWNER, FaultCode.SECOND_CONTROLLER})
"""Refusals that say that the command was another controller's."""
AFTER_A_LOSS = (
    "the job's result is complete, its record is not, and record_detail states what is missing: "
    "see what else uses disk and processors, and repeat the job where the record is needed"
)


@dataclass(slots=True)
class GrowthDetector:
    """Detects growth of a counter beyond a limit; a smaller value is a restart."""

    limit: int
    """Growth within ``window_s`` at which it is reported."""
    window_s: float
    _last: int | None = None
    _since_s: float = 0.0
    _grown: int = 0

    def update(self, value: int, now_s: float) -> int:
        """Take a value; returns the growth once it has reached the limit, else 0."""
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
    """Raises and clears alarms by what is known; asks the programs only rarely."""

    def __init__(self, context: RigContext, active: Callable[[], ActiveJob | None]) -> None:
        self._context, self._active = context, active
        self._conditions: dict[str, Condition] = {}
        self._known = False
        """Whether what an earlier supervisor has left standing was looked up."""
        self._tripped = False
        self._asked_s = self._busy_s = float("-inf")
        missed = max(1, round(MISSED_SHARE * MISSED_S / context.rig.rig.period_s))
        self._refused = GrowthDetector(REFUSED, REFUSED_S)
        self._missed = GrowthDetector(missed, MISSED_S)
        self._lost = GrowthDetector(1, REFUSED_S)
        self._repeated = RepeatedAction(f"alarms-{context.rig.rig.name}", LOOK_S, self.poll)

    def start(self) -> None:
        """Poll in a thread from here on."""
        self._repeated.start()

    def close(self) -> None:
        """Stop polling."""
        self._repeated.close(JOIN_S)

    def poll(self) -> None:
        """Compare what is with what was, once."""
        context = self._context
        if context.write_queue.flush() and context.store.trouble:
            context.store.probe()
        self._poll_trip()
        self._poll_conditions()
        self._poll_refusals()
        if not context.rig.lockstep:  # where programs may take as long as they like
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
                alarms.clear(cause, f"over: {one.words}")
        self._conditions = found

    def _previous_conditions(self) -> dict[str, Condition]:
        """Return what stood at the last look; at the first, what an earlier supervisor has left."""
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
        """Ask the programs for what they have counted."""
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
        """Let the sensor sample seldom once the rig has had no job for a while."""
        actuator = self._context.health.status("actuator")
        at_rest = actuator is not None and actuator.mode in AT_REST
        if not at_rest or self._active() is not None or self._busy_s == float("-inf"):
            self._busy_s = now_s
        elif now_s - self._busy_s >= IDLE_S:
            self._context.health.let_sample_seldom()

    def _raise_transient(self, cause: str, words: str) -> None:
        self._context.alarms.raise_alarm(
            cause, words, severity="warning", clears="acknowledge", job=self._job()
        )

    def _job(self) -> str | None:
        live = self._active()
        return None if live is None else live.id
