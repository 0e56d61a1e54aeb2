"""The alarm log of a rig: raised, counted, cleared and acknowledged, and told as events.

What cannot be written keeps its time, and is written as soon as it can be. Never called from the
event loop.
"""

import threading
from typing import Any

from pincette_supervisor.journal.alarm_rows import AlarmBook, AlarmRow, Clears, Raised, Severity
from pincette_supervisor.journal.store import Store, StoreError, utc_now
from pincette_supervisor.running.backlog import Backlog
from pincette_supervisor.running.causes import code_of
from pincette_supervisor.running.events import EventLog


class AlarmLog:
    """Alarms of one rig."""

    def __init__(self, store: Store, events: EventLog, backlog: Backlog) -> None:
        self._book, self._events, self.rig = AlarmBook(store), events, events.rig
        self._backlog = backlog
        self._lock = threading.Lock()
        self._tripped: str | None = None
        """Cause of the trip that was raised last, until it is cleared."""
        self._new = True
        """Whether what an earlier supervisor has raised was not looked up yet."""
        self._by: dict[str, str] = {}
        """Who has asked for a trip that is not raised yet, by its cause."""

    def raised(
        self,
        cause: str,
        words: str,
        *,
        severity: Severity = "warning",
        clears: Clears = "condition",
        job: str | None = None,
        told_cause: str = "",
        **told: Any,
    ) -> None:
        """Raise an alarm, or count it once more.

        ``told`` goes with the event, and so does ``told_cause`` in place of the code.
        """
        one = Raised(self.rig, cause, words, utc_now(), severity, clears, job)

        def write() -> None:
            about: dict[str, Any] = {}
            said = {"cause": told_cause or cause, "words": words}
            body = {**said, **told, "did": "raised", "alarm": about}
            with self._events.telling("alarm", job, **body):
                about.update(_about(self._book.add(one)))

        self._backlog.do(write)

    def expect(self, cause: str, by: str) -> None:
        """Note who asks for a trip, before the actuator is asked."""
        with self._lock:
            self._by[cause] = by

    def tripped(self, cause: str, words: str, job: str | None, detail: str = "") -> None:
        """Raise the alarm of a trip, once however many have noticed it.

        ``cause`` is as the actuator has it, ``detail`` what went wrong with it.
        """
        with self._lock:
            if self._tripped == cause or self._stands_already(code_of(cause)):
                self._tripped = cause
                return
            self._tripped = cause
            by = self._by.pop(cause, "")
        said = f"{words}, by {by}" if by else words
        self.raised(
            code_of(cause),
            f"{said}; {detail}" if detail else said,
            severity="warning" if cause == "abort" else "alarm",
            clears="reset",
            job=job,
            told_cause=cause,
            by=by,
            detail=detail,
        )

    def _stands_already(self, code: str) -> bool:
        """Whether an earlier supervisor has raised the trip that the actuator is still in."""
        if not self._new:
            return False
        try:
            rows = self._book.standing(self.rig)
        except StoreError:
            return False
        self._new = False
        return any((row.clears, row.cause) == ("reset", code) for row in rows)

    def cleared(self, cause: str, words: str) -> None:
        """Note that the condition of an alarm is over; nothing is told where none stands."""
        at = utc_now()

        def write() -> None:
            self._end(at, "condition", words, cause)

        self._backlog.do(write)

    def reset(self) -> None:
        """Note that the actuator's latch is cleared, and with it every trip."""
        with self._lock:
            self._tripped = None
            self._by.clear()
        at = utc_now()

        def write() -> None:
            self._book.clear(self.rig, at, clears="reset")

        self._backlog.do(write)

    def _end(self, at: str, clears: Clears, words: str, cause: str) -> None:
        standing = [row for row in self._book.standing(self.rig) if row.cause == cause]
        if not standing:
            return
        about: dict[str, Any] = {}
        with self._events.telling(
            "alarm", None, cause=cause, words=words, did="cleared", alarm=about
        ):
            for row in self._book.clear(self.rig, at, cause=cause, clears=clears):
                about.update(_about(row))

    def standing(self) -> list[AlarmRow]:
        """Alarms whose condition was not seen to be over; raises StoreError."""
        return [row for row in self._book.standing(self.rig) if row.clears == "condition"]

    def acknowledge(self, number: int, by: str) -> AlarmRow | None:
        """Note that a person has seen an alarm; None where there is none of this number.

        Raises
        ------
        StoreError
            Where it cannot be written: whoever asks is to know.
        """
        before = self._book.get(number)
        if before is None or before.acknowledged_at is not None:
            return before
        about: dict[str, Any] = {}
        body = {
            "cause": before.cause,
            "words": before.words,
            "did": "acknowledged",
            "by": by,
            "alarm": about,
        }
        with self._events.telling("alarm", before.job, **body):
            after = self._book.acknowledge(number, utc_now(), by)
            about.update({} if after is None else _about(after))
        return after


def _about(row: AlarmRow) -> dict[str, Any]:
    return {
        "id": row.number,
        "cause": row.cause,
        "severity": row.severity,
        "count": row.count,
    }
