"""Who listens to events, and what waits for them on the way from any thread to the event loop."""

import asyncio
import threading
from collections import deque
from contextlib import suppress
from weakref import WeakSet

from pincette_supervisor.journal.rows import EventRow

MOST = 64
"""Listeners at once."""
ROOM = 256
"""Events that wait for one listener; one that is slower reads the journal again."""


class TooManyListenersError(Exception):
    """There is no room for one more."""


class Mailbox:
    """Events on their way to one listener, of all jobs or of one, of all rigs or of one."""

    def __init__(self, rig: str | None, job: str | None) -> None:
        self._rig, self._job = rig, job
        self._loop = asyncio.get_running_loop()
        self._woken = asyncio.Event()
        self._lock = threading.Lock()
        self._waiting: deque[EventRow] = deque()
        self._behind = True
        """Something numbered is in the journal and not here."""
        self._dropped = 0
        self.closed = False

    def put(self, event: EventRow) -> None:
        """Leave an event, from any thread; what finds no room is counted or read again later."""
        if (self._rig or event.rig) != event.rig or (self._job or event.job) != event.job:
            return
        with self._lock:
            if len(self._waiting) < ROOM:
                self._waiting.append(event)
            elif event.number is None:
                self._dropped += 1
            else:
                self._behind = True
        self._wake()

    def take(self) -> tuple[list[EventRow], int, bool]:
        """What waits; how much in passing was dropped; whether the journal must be read instead.

        What is numbered is in the journal before it is here, so that reading it misses nothing.
        """
        with self._lock:
            self._woken.clear()
            waiting, dropped, behind = list(self._waiting), self._dropped, self._behind
            self._waiting.clear()
            self._dropped, self._behind = 0, False
        if behind:
            dropped += sum(event.number is None for event in waiting)
            waiting = []
        return waiting, dropped, behind

    async def wait(self, timeout_s: float) -> None:
        """Return when something has come, or in time."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._woken.wait()
        except TimeoutError:
            return

    def close(self) -> None:
        """Nothing more will come; from any thread."""
        self.closed = True
        self._wake()

    def _wake(self) -> None:
        # The loop may end at any moment, and nobody listens then.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._woken.set)


class Listeners:
    """All mailboxes; one that nobody holds any more is forgotten."""

    def __init__(self) -> None:
        self.order = threading.Lock()
        """Held while an event gets its number and is told, so that numbers come in order."""
        self._lock = threading.Lock()
        self._boxes: WeakSet[Mailbox] = WeakSet()
        self._closed = False

    def open(self, rig: str | None, job: str | None) -> Mailbox:
        """Begin to collect for a listener of the running event loop.

        Raises
        ------
        TooManyListenersError
            Where there is no room for one more.
        """
        box = Mailbox(rig, job)
        with self._lock:
            if len(self._boxes) >= MOST:
                raise TooManyListenersError(f"{MOST} listen to events already, which is the most")
            self._boxes.add(box)
            box.closed = self._closed
        return box

    def leave(self, box: Mailbox) -> None:
        """Make room for another."""
        with self._lock:
            self._boxes.discard(box)

    def put(self, event: EventRow) -> None:
        """Tell all; from any thread."""
        for box in self._all():
            box.put(event)

    def close(self) -> None:
        """End: whoever listens is told that nothing more will come."""
        with self._lock:
            self._closed = True
        for box in self._all():
            box.close()

    def _all(self) -> list[Mailbox]:
        with self._lock:
            return list(self._boxes)
