"""Event queues from any thread to the listeners on the event loop."""

import asyncio
import threading
from collections import deque
from contextlib import suppress
from weakref import WeakSet

from pincette.api.events import Event

LISTENERS_MAX = 256
"""Listeners of all clients at once; each client has a limit of its own, of all its streams."""
CAPACITY = 256
"""Events queued for one listener; a slower one reads the journal again."""


class TooManyListenersError(Exception):
    """The number of listeners is at its limit."""


class ListenerQueue:
    """Events queued for one listener, of all rigs or one, of all jobs or one."""

    def __init__(self, rig: str | None, job: str | None) -> None:
        self._rig, self._job = rig, job
        self._loop = asyncio.get_running_loop()
        self._ready = asyncio.Event()
        self._lock = threading.Lock()
        self._queue: deque[Event] = deque()
        self._behind = True
        """Whether the journal has numbered events that are not queued here."""
        self._dropped = 0
        self.closed = False

    def put(self, event: Event) -> None:
        """Queue an event, from any thread; beyond the capacity it is counted or read again."""
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
        """The queued events, the number dropped, and whether the journal must be read instead."""
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
        """End; from any thread."""
        self.closed = True
        self._wake()

    def _wake(self) -> None:
        # The loop may end at any moment.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._ready.set)


class Listeners:
    """The queues of all listeners; one without references is dropped."""

    def __init__(self) -> None:
        self.order = threading.Lock()
        """Held while an event is numbered and queued, so that numbers come in order."""
        self._lock = threading.Lock()
        self._queues: WeakSet[ListenerQueue] = WeakSet()
        self._closed = False

    def open(self, rig: str | None, job: str | None) -> ListenerQueue:
        """A queue for a listener on the running event loop; raises TooManyListenersError."""
        queue = ListenerQueue(rig, job)
        with self._lock:
            if len(self._queues) >= LISTENERS_MAX:
                raise TooManyListenersError(
                    f"{LISTENERS_MAX} listen to events already, which is the most"
                )
            self._queues.add(queue)
            queue.closed = self._closed
        return queue

    def leave(self, queue: ListenerQueue) -> None:
        """Remove a queue."""
        with self._lock:
            self._queues.discard(queue)

    def put(self, event: Event) -> None:
        """Queue an event for all; from any thread."""
        for queue in self._all():
            queue.put(event)

    def close(self) -> None:
        """End all queues."""
        with self._lock:
            self._closed = True
        for queue in self._all():
            queue.close()

    def _all(self) -> list[ListenerQueue]:
        with self._lock:
            return list(self._queues)
