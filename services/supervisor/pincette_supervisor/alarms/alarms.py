"""The alarm log of a rig: raised, counted, cleared and acknowledged, each with an event."""

import threading
from typing import Any

from pincette.core.faults import Cause
from pincette_supervisor.alarms.trips import TripReason
from pincette_supervisor.journal.alarm_rows import AlarmRepository, AlarmRow, Clears, Severity
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import Store, StoreError, utc_now
from pincette_supervisor.journal.write_queue import WriteQueue


class AlarmLog:
    """Alarms of one rig; what cannot be written keeps its time, and is written later."""

    def __init__(self, store: Store, events: EventLog, write_queue: WriteQueue) -> None:
        self._repository, self._events, self.rig = AlarmRepository(store), events, events.rig
        self._write_queue = write_queue
        self._lock = threading.Lock()
        self._tripped: TripReason | None = None
        """Reason of the trip that was raised last, until it is cleared."""
        self._new = True
        """Whether what an earlier supervisor has raised was not looked up yet."""
        self._by: dict[Cause, str] = {}
        """Who has asked for a trip that is not raised yet, by its cause."""

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
        """Raise an alarm, or count it once more; ``details`` go with the event."""
        alarm = AlarmRow(self.rig, cause, words, utc_now(), severity, clears, job)

        def write() -> None:
            about: dict[str, Any] = {}
            body = {"cause": cause, "words": words, **details, "did": "raised", "alarm": about}
            with self._events.transaction("alarm", job, **body):
                about.update(_about(self._repository.add(alarm)))

        self._write_queue.submit(write)

    def expect(self, cause: Cause, by: str) -> None:
        """Note who requests a trip, before the actuator is asked; the first of several counts.

        A page repeats a stop without its credentials where the reply takes long.
        """
        with self._lock:
            self._by.setdefault(cause, by)

    def raise_trip(self, reason: TripReason, words: str, job: str | None, detail: str = "") -> None:
        """Raise the alarm of a trip, once however often it is noticed; ``detail``: what failed."""
        # Asked without the lock, which an emergency stop takes, too: the journal may hang.
        stands = self._stands_already(reason.cause)
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

    def _stands_already(self, code: str) -> bool:
        """Whether an earlier supervisor has raised the trip that the actuator is still in."""
        if not self._new:
            return False
        try:
            rows = self._repository.standing(self.rig)
        except StoreError:
            return False
        self._new = False
        return any((row.clears, row.cause) == ("reset", code) for row in rows)

    def clear(self, cause: str, words: str) -> None:
        """Note that the condition of an alarm is over; has no effect where none stands."""
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
        """Note that the actuator's latch is cleared, and with it every trip."""
        with self._lock:
            self._tripped = None
            self._by.clear()
        at = utc_now()

        def write() -> None:
            self._repository.clear(self.rig, at, clears="reset")

        self._write_queue.submit(write)

    def open_conditions(self) -> list[AlarmRow]:
        """Alarms whose condition was not seen to be over; raises StoreError."""
        return [row for row in self._repository.standing(self.rig) if row.clears == "condition"]

    def acknowledge(self, number: int, by: str) -> AlarmRow | None:
        """Note that a person has seen an alarm; None without such an alarm; raises StoreError."""
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
