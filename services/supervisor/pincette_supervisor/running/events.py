"""Events of a rig: kept in the journal and numbered, and told to all who listen."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import contextmanager
from typing import Any, cast

from pincette.api.event_models import Event, EventKind, PassingKind
from pincette_supervisor.journal.store import EventRow, Store, utc_now
from pincette_supervisor.running.listeners import Listeners

PAGE = 200
"""Events that are read from the journal at once."""
LIFE_S = 10.0
"""After so long without an event a listener hears that the line is whole."""


class EventLog:
    """What happens to one rig and its jobs.

    Rigs that share a journal share ``listeners`` too: who listens to all of them asks any.
    """

    def __init__(self, store: Store, rig: str, listeners: Listeners | None = None) -> None:
        self._store, self.rig = store, rig
        self.listeners = Listeners() if listeners is None else listeners

    def tell(self, kind: EventKind, /, job: str | None = None, **body: Any) -> None:
        """Keep an event and tell it; from any thread, but never from the event loop.

        Raises
        ------
        StoreError
            Where it cannot be kept; nobody is told then.
        """
        with self.telling(kind, job, **body):
            pass

    @contextmanager
    def telling(
        self, kind: EventKind, /, job: str | None = None, **body: Any
    ) -> Generator[list[Callable[[], None]]]:
        """Change the journal, and tell of it: change and event are kept both or not at all.

        Nothing but the journal may be asked within; see ``tell``. Gives a list for what is to be
        done once both are kept, before anybody hears of it.
        """
        with self.listeners.order:
            done: list[Callable[[], None]] = []
            with self._store.writing():
                yield done
                at = utc_now()
                number = self._store.add_event(at, self.rig, job, kind, body)
            for deed in done:
                deed()
            self.listeners.put(EventRow(number, at, self.rig, job, kind, body))

    def progress(self, job: str, body: dict[str, Any]) -> None:
        """Tell how far a job is to those who listen just then; nothing is kept."""
        self.listeners.put(EventRow(None, utc_now(), self.rig, job, "progress", body))

    def open(
        self, after: int | None = None, job: str | None = None, *, every_rig: bool = False
    ) -> "Listening":
        """Begin to listen; see ``Listening``.

        Raises
        ------
        TooManyListenersError
            Where there is no room for one more.
        """
        return Listening(self, self._store, after, job, None if every_rig else self.rig)

    async def listen(
        self, after: int | None = None, job: str | None = None, *, every_rig: bool = False
    ) -> AsyncGenerator[Event]:
        """Every event beyond a number, then those that come, until the log is closed.

        Raises
        ------
        TooManyListenersError
            Where there is no room for one more.
        """
        listening = self.open(after, job, every_rig=every_rig)
        try:
            while (events := await listening.next()) is not None:
                for event in events:
                    yield event
        finally:
            listening.close()

    def close(self) -> None:
        """End: whoever listens hears no more."""
        self.listeners.close()


class Listening:
    """One listener: reads the journal beyond ``after``, then hears what is told, without a gap.

    It hears nothing of the past where ``after`` is None. Numbered events come in order and once.
    A listener that is slower than what is told reads the journal again; what is told in passing it
    misses meanwhile, which is counted and told.
    """

    def __init__(
        self, log: EventLog, store: Store, after: int | None, job: str | None, rig: str | None
    ) -> None:
        self._log, self._store, self._after = log, store, after
        self._job, self._rig = job, rig
        self._box = log.listeners.open(rig, job)
        self._gone = 0
        """How many numbered events of the past are kept no more."""
        self._begun = self._reads = self._ended = False

    @property
    def caught_up(self) -> bool:
        """Whether all of the past has been given out."""
        return self._begun and not self._reads

    async def begin(self) -> None:
        """Find the place to begin at: what is told from here on is heard."""
        if self._begun:
            return
        oldest, newest = await asyncio.to_thread(self._store.event_span)
        # A number that was not given yet is of a journal that was there before this one.
        after = newest if self._after is None else self._after if self._after <= newest else 0
        self._gone = max(oldest - 1 - after, 0)
        _, _, self._reads = self._box.take()
        self._after, self._begun = after, True

    async def next(self, timeout_s: float = LIFE_S) -> list[Event] | None:
        """Events, none where none came in time, or None where nothing more will come."""
        if self._ended:
            return None
        await self.begin()
        self._ended = self._box.closed
        if self._gone:
            gone, self._gone = self._gone, 0
            return [self._lost(numbered=gone)]
        if self._reads:
            return await self._read()
        if not self._ended:
            await self._box.wait(timeout_s)
        rows, dropped, self._reads = self._box.take()
        last = self._after or 0
        fresh = [row for row in rows if row.number is None or row.number > last]
        told = [self._lost(progress=dropped)] if dropped else []
        return told + [self._heard(row) for row in fresh]

    async def _read(self) -> list[Event]:
        rows = await asyncio.to_thread(
            self._store.events_after, self._after or 0, rig=self._rig, job=self._job, limit=PAGE
        )
        self._reads = len(rows) == PAGE
        return [self._heard(row) for row in rows]

    def _heard(self, row: EventRow) -> Event:
        if row.number is not None:
            self._after = row.number
        return event_of(row)

    def _lost(self, **counts: int) -> Event:
        kind: PassingKind = "dropped"
        return Event(
            number=None,
            at=utc_now(),
            rig=self._rig or self._log.rig,
            job=self._job,
            kind=kind,
            body={"progress": 0, "numbered": 0, **counts},
        )

    def close(self) -> None:
        """Make room for another listener."""
        self._log.listeners.leave(self._box)


def event_of(row: EventRow) -> Event:
    """An event as REST tells it."""
    return Event(
        number=row.number,
        at=row.at,
        rig=row.rig,
        job=row.job,
        kind=cast(EventKind | PassingKind, row.kind),
        body=row.body,
    )
