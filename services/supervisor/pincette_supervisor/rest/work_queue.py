"""Queue of the connections that have work, of which each turn of the event loop does a part.

An event loop runs all callbacks that are ready before it looks at its sockets again. Without this
queue, data of many connections that arrive together would delay a stop by the sum of their work.
"""

import asyncio
import select
import selectors
from abc import abstractmethod
from time import monotonic
from typing import Protocol

TURN_S = 0.002
"""Time of one turn of the event loop after which the rest of the queue waits for the next turn."""
TASKS = 2
"""Tasks that are started in one turn. A request takes some 2 ms of the next turn."""
BREAK_S = 0.003
"""Time between two turns of the queue. A stop takes about ten turns of the event loop, most of
which are short then."""
FRESH = 128
"""Newest silent connections that are not ended to make room: their data may be on the way."""
LOOKED_AT = 32
"""Number of silent connections among which one without data is looked for."""


class Peer(Protocol):
    """A connection."""

    @abstractmethod
    def has_unread_data(self) -> bool:
        """Return whether data have arrived that must be read before the connection may be ended."""

    @abstractmethod
    def work(self) -> bool:
        """Do a small piece of work; returns whether it has started a task, which has its own."""

    @abstractmethod
    def abort(self) -> None:
        """End the connection."""


class WorkQueue:
    """The connections of one server that wait: for data of their clients, or for their turn."""

    def __init__(self, break_s: float = BREAK_S, *, alternates: bool = False) -> None:
        """``alternates``: the newest has its turn, then the oldest, and so on."""
        self._break_s, self._alternates, self._newest = break_s, alternates, alternates
        self._silent: dict[Peer, None] = {}
        """Connections that wait for the data of their first request; the longest silent first."""
        self._kept: dict[Peer, None] = {}
        """Connections that wait for data and have been of use; the longest silent first."""
        self._ready: dict[Peer, None] = {}
        """Connections that wait for their turn; the first one has it next."""
        self._turn: asyncio.Handle | None = None
        self._next_s = 0.0
        """Time before which the queue takes no turn."""

    def __len__(self) -> int:
        return len(self._silent) + len(self._kept) + len(self._ready)

    def add(self, peer: Peer) -> None:
        """Enqueue the work of a connection."""
        self._silent.pop(peer, None)
        self._kept.pop(peer, None)
        self._ready[peer] = None
        self._schedule()

    def add_silent(self, peer: Peer, *, kept: bool = False) -> None:
        """Note that a connection waits for data, unless it waits for its turn.

        ``kept``: it has had an answer that was no refusal, and is ended after those that have not.
        """
        if peer not in self._ready:
            self.discard(peer)
            (self._kept if kept else self._silent)[peer] = None

    def discard(self, peer: Peer) -> None:
        """Forget a connection."""
        self._silent.pop(peer, None)
        self._kept.pop(peer, None)
        self._ready.pop(peer, None)

    def pop_silent(self) -> Peer | None:
        """Remove and return the connection to end to make room; None if all are fresh.

        The one that has been silent longest, of those without an answer first.
        """
        for waiting in (self._silent, self._kept):
            for _ in range(min(LOOKED_AT, len(waiting) - FRESH)):
                peer = next(iter(waiting))
                del waiting[peer]
                if not peer.has_unread_data():
                    return peer
                waiting[peer] = None
        return None

    def pop_last(self) -> Peer | None:
        """Remove and return the last one of the queue; those before it are served sooner."""
        return self._ready.popitem()[0] if self._ready else None

    def _schedule(self) -> None:
        if self._ready and self._turn is None:
            loop, wait_s = asyncio.get_running_loop(), self._next_s - monotonic()
            later = wait_s > 0.0
            self._turn = loop.call_later(wait_s, self._run) if later else loop.call_soon(self._run)

    def _pop_next(self) -> Peer:
        peer = next(reversed(self._ready) if self._newest else iter(self._ready))
        del self._ready[peer]
        self._newest = self._alternates and not self._newest
        return peer

    def _run(self) -> None:
        self._turn = None
        until_s, tasks = monotonic() + TURN_S, 0
        try:
            while self._ready and tasks < TASKS and monotonic() < until_s:
                tasks += self._pop_next().work()
        finally:  # an error in one connection does not stop the others
            self._next_s = monotonic() + self._break_s
            self._schedule()


def has_data(transport: asyncio.BaseTransport) -> bool:
    """Return whether data, or the end of the connection, have arrived and wait to be read."""
    opened = transport.get_extra_info("socket")
    if opened is None or opened.fileno() < 0:
        return False
    poll = select.poll()
    poll.register(opened.fileno(), select.POLLIN)
    return bool(poll.poll(0))


# Event loop whose turns have a bounded number of socket events.
#
# asyncio handles all sockets that are ready before it does anything else. When a client closes 500
# connections at once, that is one turn of a tenth of a second; a stop takes about ten turns.

EVENTS = 24
"""Socket events of one turn; the others are handled in the next ones."""


class BoundedSelector(selectors.DefaultSelector):
    """Selector that returns at most ``EVENTS`` events, of all ready sockets in rotation."""

    _place = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for events; the sockets that are left out are still ready the next time."""
        ready = super().select(timeout)
        if len(ready) <= EVENTS:
            return ready
        begin = self._place % len(ready)
        self._place = begin + EVENTS
        return (ready[begin:] + ready[:begin])[:EVENTS]


def new_loop() -> asyncio.AbstractEventLoop:
    """Build the event loop of the REST server."""
    return asyncio.SelectorEventLoop(BoundedSelector())
