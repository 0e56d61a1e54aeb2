"""Queue of the connections that have work, of which each turn of the event loop does a part.

An event loop runs all callbacks that are ready before it looks at its sockets again. Without this
queue, data of many connections that arrive together would delay a stop by the sum of their work.
"""

import asyncio
from abc import abstractmethod
from time import monotonic
from typing import Protocol

TURN_S = 0.002
"""Time of one turn of the event loop after which the rest of the queue waits for the next turn."""
TASKS = 2
"""Tasks that are started in one turn. A request takes some 2 ms of the next turn."""
FRESH = 128
"""Newest silent connections that are not ended to make room: their data may be on the way."""


class Peer(Protocol):
    """A connection."""

    @abstractmethod
    def work(self) -> bool:
        """Do a small piece of work; returns whether it has started a task, which has its own."""

    @abstractmethod
    def abort(self) -> None:
        """End the connection."""


class WorkQueue:
    """The connections of one server that wait: for data of their clients, or for their turn."""

    def __init__(self) -> None:
        self._silent: dict[Peer, None] = {}
        """Connections that wait for data; the longest silent first."""
        self._ready: dict[Peer, None] = {}
        """Connections that wait for their turn; the first one has it next."""
        self._turn: asyncio.Handle | None = None

    def __len__(self) -> int:
        return len(self._silent) + len(self._ready)

    def add(self, peer: Peer) -> None:
        """Enqueue the work of a connection."""
        self._silent.pop(peer, None)
        self._ready[peer] = None
        self._schedule()

    def add_silent(self, peer: Peer) -> None:
        """Note that a connection waits for data, unless it waits for its turn."""
        if peer not in self._ready:
            self._silent[peer] = None

    def discard(self, peer: Peer) -> None:
        """Forget a connection."""
        self._silent.pop(peer, None)
        self._ready.pop(peer, None)

    def pop_silent(self) -> Peer | None:
        """Remove and return the connection that has been silent longest; None if all are fresh."""
        if len(self._silent) <= FRESH:
            return None
        peer = next(iter(self._silent))
        del self._silent[peer]
        return peer

    def pop_last(self) -> Peer | None:
        """Remove and return the last one of the queue; those before it are served sooner."""
        return self._ready.popitem()[0] if self._ready else None

    def _schedule(self) -> None:
        if self._ready and self._turn is None:
            self._turn = asyncio.get_running_loop().call_soon(self._run)

    def _run(self) -> None:
        self._turn = None
        until_s, tasks = monotonic() + TURN_S, 0
        try:
            while self._ready and tasks < TASKS and monotonic() < until_s:
                peer = next(iter(self._ready))
                del self._ready[peer]
                tasks += peer.work()
        finally:  # an error in one connection does not stop the others
            self._schedule()
