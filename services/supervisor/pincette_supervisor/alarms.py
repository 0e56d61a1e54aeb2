"""Alarms of a rig: raised, counted, cleared and acknowledged, each with an event."""

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

from pincette.api.checks import FaultView
from pincette.api.endings import Ending
from pincette.config import RigFile
from pincette.core.faults import TRIPPED, Cause, Fault, FaultCode
from pincette.core.messages import Applied, Command, Estimate, Message, Position, Telemetry
from pincette.core.topics import Topic
from pincette.core.wording import cause_text, fault_text
from pincette_supervisor.journal.events import AlarmRepository, AlarmRow, Clears, EventLog, Severity
from pincette_supervisor.journal.store import Store, StoreError, utc_now
from pincette_supervisor.journal.write_queue import WriteQueue

# Reason why the actuator has tripped, with the program that was silent at that moment.

# The actuator only detects that no command arrived. The silent program is found from outside, by
# the numbers of the programs' newest samples at the moment of the trip.


LATE_PERIODS = 1.5
"""Number of periods after which a sensor without a new sample counts as silent."""
IN_FLIGHT = 1
"""Number of samples by which a program may lag behind the previous program of the loop."""


def fault_views(faults: Iterable[Fault]) -> list[FaultView]:
    """Return faults as the REST interface represents them."""
    return [
        FaultView(
            code=fault.code,
            values={item.name: item.value for item in fault.values},
            text=fault_text(fault),
        )
        for fault in faults
    ]


class TripReason(NamedTuple):
    """Reason why the actuator is latched: a code, and its faults."""

    cause: Cause
    faults: tuple[Fault, ...] = ()

    def with_fault(self, found: Fault) -> "TripReason":
        """Return this reason with one more fault."""
        return TripReason(self.cause, (*self.faults, found))

    def text(self, silent: str = "") -> str:
        """Return the reason in words; ``silent`` is the program that was silent at that time."""
        return cause_text(self.cause, self.faults, silent)


@dataclass(frozen=True, slots=True)
class LastSample:
    """Newest sample of a program, and its age."""

    seq: int
    age_s: float


@dataclass(frozen=True, slots=True)
class TripRecord:
    """A trip, kept until the actuator is reset."""

    epoch: int
    reason: TripReason
    newest: Mapping[str, LastSample]
    """Newest sample of each program of the loop at the time of the trip."""
    at_s: float = 0.0
    """Time of the trip, or of a change of its reason, in s."""


def reason_of(applied: Applied) -> TripReason:
    """Return the reason that the actuator reports."""
    return TripReason(applied.cause, applied.faults)


def trip_ending(trip: TripReason) -> Ending:
    """Return the ending of a job whose actuator has tripped; an abort by a person is not a
    fault."""
    if trip.cause == Cause.ABORT:
        return Ending(code="requested")
    return Ending(code="tripped", trip=str(trip.cause), faults=fault_views(trip.faults))


def silent_program(newest: Mapping[str, LastSample], period_s: float) -> str:
    """Return the first silent program, in the order of a tick; empty if none is silent."""
    sensor = newest.get("sensor")
    if sensor is None:
        return ""
    if sensor.age_s > LATE_PERIODS * period_s:
        return "sensor"
    seq = sensor.seq
    for program in ("estimator", "controller"):
        one = newest.get(program)
        if one is None or one.seq < seq - IN_FLIGHT:
            return program
        seq = min(seq, one.seq)
    return ""


def output_lost(reason: TripReason) -> bool:
    """Return whether the output does not confirm its voltage."""
    codes = {one.code for one in reason.faults}
    return reason.cause == Cause.DEVICE or FaultCode.OUTPUT_UNCONFIRMED in codes


class TripMonitor:
    """Monitor of the actuator's present trip, if any; see ``take``."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.newest: TripRecord | None = None
        self._clock = clock
        self._samples: dict[str, tuple[int, int, float]] = {}
        """Epoch, number and arrival time of each program's newest sample."""

    def take(self, topic: Topic, message: Message) -> None:
        """Process a message; called in threads of the bus."""
        if isinstance(message, Applied):
            self._take_applied(message)
        elif isinstance(message, Position | Estimate | Command | Telemetry):
            self._samples[topic.producer] = (message.epoch, message.seq, self._clock())

    def _take_applied(self, applied: Applied) -> None:
        if applied.state not in TRIPPED:
            self.newest = None
        elif self.newest is None or self.newest.reason != reason_of(applied):
            now = self._clock()
            newest = {
                program: LastSample(seq, now - at_s)
                for program, (epoch, seq, at_s) in list(self._samples.items())
                if epoch == applied.epoch
            }
            self.newest = TripRecord(applied.epoch, reason_of(applied), newest, now)

    def lost_s(self, reason: TripReason) -> float | None:
        """Return the time since the loss of output that a reason reports, in s; None if unknown."""
        trip = self.newest
        return None if trip is None or trip.reason != reason else self._clock() - trip.at_s

    def words(self, reason: TripReason, rig: RigFile) -> str:
        """Return a reason in words, with the silent program if it belongs to the newest trip."""
        trip = self.newest
        if trip is None or trip.reason != reason:
            return reason.text()
        # In lockstep the wall clock says nothing about a sample's age.
        period_s = inf if rig.lockstep else rig.rig.period_s
        return reason.text(silent_program(trip.newest, period_s))


class AlarmLog:
    """Alarms of one rig.

    Alarms that cannot be written keep their time stamps, and are written later.
    """

    def __init__(self, store: Store, events: EventLog, write_queue: WriteQueue) -> None:
        self._repository, self._events, self.rig = AlarmRepository(store), events, events.rig
        self._write_queue = write_queue
        self._lock = threading.Lock()
        self._tripped: TripReason | None = None
        """Reason of the newest trip for which an alarm was raised, until the trip is cleared."""
        self._new = True
        """True until the alarms that an earlier supervisor has raised were looked up."""
        self._by: dict[Cause, str] = {}
        """Callers who requested a trip that is not raised yet, by cause."""

    def raise_alarm(
        self,
        cause: str,
        words: str,
        *,
        severity: Severity = "warning",
        clears: Clears = "condition",
        job: str | None = None,
        **details: Any,
    ) -> None:
        """Raise an alarm, or count it once more; the event contains ``details``."""
        alarm = AlarmRow(self.rig, cause, words, utc_now(), severity, clears, job)

        def write() -> None:
            about: dict[str, Any] = {}
            body = {"cause": cause, "words": words, **details, "did": "raised", "alarm": about}
            with self._events.transaction("alarm", job, **body):
                about.update(_about(self._repository.add(alarm)))

        self._write_queue.submit(write)

    def expect(self, cause: Cause, by: str) -> None:
        """Note who requests a trip, before the request is sent; later callers do not replace the
        first.

        A page repeats a stop without its credentials if the reply takes long.
        """
        with self._lock:
            self._by.setdefault(cause, by)

    def raise_trip(self, reason: TripReason, words: str, job: str | None, detail: str = "") -> None:
        """Raise the alarm of a trip, only once for each trip; ``detail`` states what failed."""
        # Queried without the lock, since an emergency stop also needs it: the journal may hang.
        stands = self._is_raised_already(reason.cause)
        with self._lock:
            by = self._by.pop(reason.cause, "")
            known = self._tripped == reason or stands
            self._tripped = reason
            if known:
                return
        text = f"{words}, by {by}" if by else words
        self.raise_alarm(
            str(reason.cause),
            f"{text}; {detail}" if detail else text,
            severity="warning" if reason.cause == Cause.ABORT else "alarm",
            clears="reset",
            job=job,
            by=by,
            detail=detail,
        )

    def _is_raised_already(self, code: str) -> bool:
        """Return whether an earlier supervisor has raised the actuator's present trip."""
        if not self._new:
            return False
        try:
            rows = self._repository.standing(self.rig)
        except StoreError:
            return False
        self._new = False
        return any((row.clears, row.cause) == ("reset", code) for row in rows)

    def clear(self, cause: str, words: str) -> None:
        """Record that the condition of an alarm has ended; has no effect without such an alarm."""
        at = utc_now()

        def write() -> None:
            if not any(row.cause == cause for row in self._repository.standing(self.rig)):
                return
            about: dict[str, Any] = {}
            with self._events.transaction(
                "alarm", None, cause=cause, words=words, did="cleared", alarm=about
            ):
                for row in self._repository.clear(self.rig, at, cause=cause, clears="condition"):
                    about.update(_about(row))

        self._write_queue.submit(write)

    def reset(self) -> None:
        """Record that the actuator's latch is cleared, and with it every trip."""
        with self._lock:
            self._tripped = None
            self._by.clear()
        at = utc_now()

        def write() -> None:
            self._repository.clear(self.rig, at, clears="reset")

        self._write_queue.submit(write)

    def open_conditions(self) -> list[AlarmRow]:
        """Return the alarms whose condition has not been seen to end; raises StoreError."""
        return [row for row in self._repository.standing(self.rig) if row.clears == "condition"]

    def acknowledge(self, number: int, by: str) -> AlarmRow | None:
        """Record that a person has seen an alarm, and return the alarm; None if there is no such
        alarm. Raises StoreError.
        """
        before = self._repository.get(number)
        if before is None or before.acknowledged_at is not None:
            return before
        about: dict[str, Any] = {}
        body = {"cause": before.cause, "words": before.words, "did": "acknowledged", "by": by}
        with self._events.transaction("alarm", before.job, **body, alarm=about):
            after = self._repository.acknowledge(number, utc_now(), by)
            about.update({} if after is None else _about(after))
        return after


def _about(row: AlarmRow) -> dict[str, Any]:
    return {"id": row.number, "cause": row.cause, "severity": row.severity, "count": row.count}
