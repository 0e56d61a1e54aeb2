"""Events and alarms of a rig in the journal.

Events are numbered, stored, and passed to all listeners. An open alarm is one row, however often
its cause occurs.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, Literal
from weakref import WeakSet

from sqlalchemy import ColumnElement, Connection, and_, delete, func, insert, or_, select, update

from pincette.api.events import Event, EventKind
from pincette_supervisor.journal.database import columns, first, matching, rows
from pincette_supervisor.journal.store import Store, utc_now
from pincette_supervisor.journal.tables import ALARMS

# Event queues from any thread to the listeners on the event loop.

LISTENERS_MAX = 256
"""Largest number of listeners of all clients; each client has a separate limit for all its
streams."""
CAPACITY = 256
"""Number of events queued for one listener; a slower one reads the journal again."""


class TooManyListenersError(Exception):
    """Error raised if the number of listeners is at its limit."""


class ListenerQueue:
    """Events queued for one listener, of all rigs or one, of all jobs or one."""

    def __init__(self, rig: str | None, job: str | None) -> None:
        self._rig, self._job = rig, job
        self._loop = asyncio.get_running_loop()
        self._ready = asyncio.Event()
        self._lock = threading.Lock()
        self._queue: deque[Event] = deque()
        self._behind = True
        """True if the journal has numbered events that are not queued here."""
        self._dropped = 0
        self.closed = False

    def put(self, event: Event) -> None:
        """Queue an event, from any thread. If the queue is full, a progress event is dropped and
        counted, and any other event is read from the journal later.
        """
        if (self._rig or event.rig) != event.rig or (self._job or event.job) != event.job:
            return
        with self._lock:
            if len(self._queue) < CAPACITY:
                self._queue.append(event)
            elif event.number is None:
                self._dropped += 1
            else:
                self._behind = True
        self._wake()

    def take(self) -> tuple[list[Event], int, bool]:
        """Return the queued events, the number dropped, and whether to read the journal instead."""
        # A numbered event is in the journal before it is queued, so reading misses nothing.
        with self._lock:
            self._ready.clear()
            waiting, dropped, behind = list(self._queue), self._dropped, self._behind
            self._queue.clear()
            self._dropped, self._behind = 0, False
        if behind:
            dropped += sum(event.number is None for event in waiting)
            waiting = []
        return waiting, dropped, behind

    async def wait(self, timeout_s: float) -> None:
        """Wait for an event or the timeout."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._ready.wait()
        except TimeoutError:
            return

    def close(self) -> None:
        """Close the queue; callable from any thread."""
        self.closed = True
        self._wake()

    def _wake(self) -> None:
        # The loop may end at any moment.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._ready.set)


class Listeners:
    """The queues of all listeners; a queue without other references is dropped."""

    def __init__(self) -> None:
        self.order = threading.Lock()
        """Lock held while an event is numbered and queued, so that numbers are in order."""
        self._lock = threading.Lock()
        self._queues: WeakSet[ListenerQueue] = WeakSet()
        self._closed = False

    def open(self, rig: str | None, job: str | None) -> ListenerQueue:
        """Return a queue for a listener on the running event loop; raises TooManyListenersError."""
        queue = ListenerQueue(rig, job)
        with self._lock:
            if len(self._queues) >= LISTENERS_MAX:
                raise TooManyListenersError(
                    f"{LISTENERS_MAX} clients listen to events already, the maximum"
                )
            self._queues.add(queue)
            queue.closed = self._closed
        return queue

    def leave(self, queue: ListenerQueue) -> None:
        """Remove a queue."""
        with self._lock:
            self._queues.discard(queue)

    def put(self, event: Event) -> None:
        """Queue an event for all listeners; callable from any thread."""
        for queue in self._all():
            queue.put(event)

    def close(self) -> None:
        """Close all queues."""
        with self._lock:
            self._closed = True
        for queue in self._all():
            queue.close()

    def _all(self) -> list[ListenerQueue]:
        with self._lock:
            return list(self._queues)


# Events of a rig: stored and numbered in the journal, and passed to all listeners.

PAGE = 200
"""Number of events that are read from the journal at once."""
LIFE_S = 10.0
"""Interval of keep-alives to a listener that gets no event, in s."""


class EventLog:
    """Events of one rig and its jobs; rigs that share a journal share ``listeners`` too."""

    def __init__(self, store: Store, rig: str, listeners: Listeners | None = None) -> None:
        self._store, self.rig = store, rig
        self.listeners = Listeners() if listeners is None else listeners

    def append(self, kind: EventKind, /, job: str | None = None, **body: Any) -> None:
        """Store an event, then pass it on; raises StoreError. Not for the event loop."""
        with self.transaction(kind, job, **body):
            pass

    @contextmanager
    def transaction(
        self, kind: EventKind, /, job: str | None = None, **body: Any
    ) -> Generator[list[Callable[[], None]]]:
        """Change the journal and store an event; yields callbacks to run before it is passed on."""
        with self.listeners.order:
            callbacks: list[Callable[[], None]] = []
            with self._store.writing():
                yield callbacks
                at = utc_now()
                number = self._store.add_event(at, self.rig, job, kind, body)
            for callback in callbacks:
                callback()
            self.listeners.put(
                Event(number=number, at=at, rig=self.rig, job=job, kind=kind, body=body)
            )

    def publish_progress(self, job: str, body: dict[str, Any]) -> None:
        """Pass the progress of a job to present listeners, without storing it."""
        self.listeners.put(
            Event(number=None, at=utc_now(), rig=self.rig, job=job, kind="progress", body=body)
        )

    def subscribe(
        self, after: int | None = None, job: str | None = None, *, every_rig: bool = False
    ) -> "EventSubscription":
        """Start listening; see ``EventSubscription``; raises TooManyListenersError."""
        return EventSubscription(self, self._store, after, job, None if every_rig else self.rig)


class EventSubscription:
    """One listener: past events after ``after`` (None: none), then new ones, without a gap."""

    # A slow listener reads the journal again; the progress events it misses meanwhile are counted,
    # and reported as ``dropped``.

    def __init__(
        self, log: EventLog, store: Store, after: int | None, job: str | None, rig: str | None
    ) -> None:
        self._log, self._store, self._after = log, store, after
        self._job, self._rig = job, rig
        self._box = log.listeners.open(rig, job)
        self._given_up = 0
        """Number of requested past events that the journal has already deleted."""
        self._begun = self._reading = self._ended = False

    @property
    def caught_up(self) -> bool:
        """Return whether all past events have been returned."""
        return self._begun and not self._reading

    async def begin(self) -> None:
        """Determine the number of the event after which events are returned."""
        if self._begun:
            return
        oldest, newest = await asyncio.to_thread(self._store.event_span)
        # A number beyond the newest belongs to an earlier journal: return all events of this one.
        after = newest if self._after is None else self._after if self._after <= newest else 0
        self._given_up = max(oldest - 1 - after, 0)
        _, _, self._reading = self._box.take()
        self._after, self._begun = after, True

    async def next(self, timeout_s: float = LIFE_S) -> list[Event] | None:
        """Return new events, an empty list on timeout, or None at the end."""
        if self._ended:
            return None
        await self.begin()
        self._ended = self._box.closed
        if self._given_up:
            gone, self._given_up = self._given_up, 0
            return [self._lost(numbered=gone)]
        if self._reading:
            return await self._read()
        if not self._ended:
            await self._box.wait(timeout_s)
        rows, dropped, self._reading = self._box.take()
        last = self._after or 0
        fresh = [row for row in rows if row.number is None or row.number > last]
        lost = [self._lost(progress=dropped)] if dropped else []
        return lost + self._passed(fresh)

    async def _read(self) -> list[Event]:
        rows = await asyncio.to_thread(
            self._store.events_after, self._after or 0, rig=self._rig, job=self._job, limit=PAGE
        )
        self._reading = len(rows) == PAGE
        return self._passed(rows)

    def _passed(self, events: list[Event]) -> list[Event]:
        """Record that events are passed on."""
        self._after = max((event.number or 0 for event in events), default=0) or self._after
        return events

    def _lost(self, **counts: int) -> Event:
        return Event(
            number=None,
            at=utc_now(),
            rig=self._rig or self._log.rig,
            job=self._job,
            kind="dropped",
            body={"progress": 0, "numbered": 0, **counts},
        )

    def close(self) -> None:
        """End the subscription."""
        self._log.listeners.leave(self._box)


Severity = Literal["alarm", "warning"]
Clears = Literal["reset", "condition", "acknowledge"]

ALARMS_KEPT = 10_000
"""Smallest number of alarms that are kept; the oldest are deleted first."""
ALARMS_SWEEP = 100
"""Number of added alarms after which the oldest are deleted."""


@dataclass(frozen=True, slots=True)
class AlarmRow:
    """An alarm; it is open until it has been acknowledged and its condition is over."""

    rig: str
    cause: str
    """Code of the cause; ``words`` is for people."""
    words: str
    raised_at: str
    severity: Severity
    clears: Clears
    """Event that ends the alarm: the reset of the rig, the end of the condition, or, for a
    condition that ends at once, the acknowledgement."""
    job: str | None = None
    count: int = 1
    last_at: str = ""
    """Time of the last occurrence."""
    acknowledged_at: str | None = None
    acknowledged_by: str | None = None
    cleared_at: str | None = None
    number: int = 0
    """Number of the alarm, higher for each new alarm; 0 until it is stored."""


class AlarmRepository:
    """The alarms of a journal."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def add(self, alarm: AlarmRow) -> AlarmRow:
        """Store an alarm; an open one is counted in its row, with the newest message."""
        at = alarm.raised_at
        over_at = at if alarm.clears == "acknowledge" else None
        with self._store.writing() as connection:
            if known := _newest(connection, and_(_same(alarm), _open())):
                number, count = known.number, known.count + 1
                values = {"count": count, "words": alarm.words, "last_at": at}
                connection.execute(
                    update(ALARMS)
                    .where(ALARMS.c.number == number)
                    .values(**values, cleared_at=over_at)
                )
            else:
                kept = columns(replace(alarm, last_at=at, cleared_at=over_at), "number")
                made = connection.execute(insert(ALARMS).values(kept))
                number = int((made.inserted_primary_key or (0,))[0])
                if number % ALARMS_SWEEP == 0:
                    connection.execute(
                        delete(ALARMS).where(ALARMS.c.number <= number - ALARMS_KEPT)
                    )
            return _one(connection, number)

    def clear(
        self, rig: str, at: str, *, cause: str | None = None, clears: Clears
    ) -> list[AlarmRow]:
        """Record the end of the condition of a rig's alarms: those of a cause, or all of a kind."""
        query = select(ALARMS.c.number).where(ALARMS.c.cleared_at.is_(None))
        query = matching(query, rig=rig, clears=clears, cause=cause)
        with self._store.writing() as connection:
            numbers = connection.execute(query).scalars().all()
            which = ALARMS.c.number.in_(numbers)
            connection.execute(update(ALARMS).where(which).values(cleared_at=at))
            return [_one(connection, number) for number in numbers]

    def acknowledge(self, number: int, at: str, by: str) -> AlarmRow | None:
        """Record once that a person has seen the alarm; None if the number is unknown."""
        unseen = and_(ALARMS.c.number == number, ALARMS.c.acknowledged_at.is_(None))
        with self._store.writing() as connection:
            connection.execute(
                update(ALARMS).where(unseen).values(acknowledged_at=at, acknowledged_by=by)
            )
            return _newest(connection, ALARMS.c.number == number)

    def get(self, number: int) -> AlarmRow | None:
        """Return one alarm; None if the number is unknown."""
        with self._store.reading() as connection:
            return _newest(connection, ALARMS.c.number == number)

    def newest(
        self,
        limit: int,
        *,
        rig: str | None = None,
        job: str | None = None,
        cause: str | None = None,
        severity: str | None = None,
        only_open: bool = False,
        before: int | None = None,
    ) -> list[AlarmRow]:
        """Return alarms, newest first; only those with the given values."""
        query = select(ALARMS).order_by(ALARMS.c.number.desc()).limit(limit)
        query = matching(query, rig=rig, job=job, cause=cause, severity=severity)
        if only_open:
            query = query.where(_open())
        if before is not None:
            query = query.where(ALARMS.c.number < before)
        return self._store.rows(AlarmRow, query)

    def standing(self, rig: str) -> list[AlarmRow]:
        """Return the alarms of a rig whose condition has not been seen to end."""
        query = select(ALARMS).where(ALARMS.c.rig == rig, ALARMS.c.cleared_at.is_(None))
        return self._store.rows(AlarmRow, query)

    def count_open(self, rig: str | None = None) -> int:
        """Return the number of open alarms, of a rig or of all."""
        query = matching(select(func.count()).select_from(ALARMS).where(_open()), rig=rig)
        with self._store.reading() as connection:
            return int(connection.scalar(query) or 0)


def _open() -> ColumnElement[bool]:
    return or_(ALARMS.c.acknowledged_at.is_(None), ALARMS.c.cleared_at.is_(None))


def _same(alarm: AlarmRow) -> ColumnElement[bool]:
    same = and_(ALARMS.c.rig == alarm.rig, ALARMS.c.cause == alarm.cause)
    # A trip belongs to its job; a condition lasts beyond jobs.
    return and_(same, ALARMS.c.job == alarm.job) if alarm.clears == "reset" else same


def _newest(connection: Connection, which: ColumnElement[bool]) -> AlarmRow | None:
    query = select(ALARMS).where(which).order_by(ALARMS.c.number.desc())
    return first(connection, AlarmRow, query)


def _one(connection: Connection, number: int) -> AlarmRow:
    return rows(connection, AlarmRow, select(ALARMS).where(ALARMS.c.number == number))[0]
