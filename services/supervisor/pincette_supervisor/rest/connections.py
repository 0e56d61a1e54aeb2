"""Connections of the HTTP server: the queue of those that have work, and TLS handshakes.

An event loop runs all callbacks that are ready before it checks its sockets again. Without a queue
of the connections that have work, data of many connections that arrive together would delay a stop
by the sum of their work. Each turn of the event loop does a part of it.

asyncio would begin a handshake with each client at once, and wait a minute for it. Here a handshake
begins when its first message has arrived, and each turn of the event loop begins a few, so that
many simultaneous handshakes do not block the loop. A client has three seconds for its first
message, and three for the rest. At most 600 handshakes are pending.
"""

import asyncio
import select
import selectors
import ssl
from abc import abstractmethod
from asyncio.sslproto import SSLProtocol
from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Any, Protocol

from pincette.security.identity import Credentials

TURN_S = 0.002
"""Time of one turn of the event loop after which the rest of the queue waits for the next turn."""
TASKS = 2
"""Number of tasks that are started in one turn. A request takes some 2 ms of the next turn."""
BREAK_S = 0.003
"""Time between two turns of the queue, in s. A stop takes about ten turns of the event loop, most
of which are then short."""
FRESH = 128
"""Number of newest silent connections that are not closed to make room: their data may be on the
way."""
LOOKED_AT = 32
"""Number of silent connections that are examined to find one without data."""


class Peer(Protocol):
    """A connection that the queue can serve or close."""

    @abstractmethod
    def has_unread_data(self) -> bool:
        """Return whether received data must be read before the connection may be closed."""

    @abstractmethod
    def work(self) -> bool:
        """Do a small piece of work; return whether it has started a task, which runs separately."""

    @abstractmethod
    def abort(self) -> None:
        """Close the connection at once."""


class WorkQueue:
    """Connections of one server that wait for data of their clients, or for their turn."""

    def __init__(self, break_s: float = BREAK_S, *, alternates: bool = False) -> None:
        """Create a queue; with ``alternates``, the newest and the oldest are served in turn."""
        self._break_s, self._alternates, self._newest = break_s, alternates, alternates
        self._silent: dict[Peer, None] = {}
        """Connections that wait for the data of their first request; the longest silent one
        first."""
        self._kept: dict[Peer, None] = {}
        """Connections that wait for data and have had a successful request; the longest silent one
        first."""
        self._ready: dict[Peer, None] = {}
        """Connections that wait for their turn; the first one is served next."""
        self._turn: asyncio.Handle | None = None
        self._next_s = 0.0
        """Time before which the queue serves no waiting connection, in s."""

    def __len__(self) -> int:
        return len(self._silent) + len(self._kept) + len(self._ready)

    def add(self, peer: Peer) -> None:
        """Enqueue a connection that has work."""
        self._silent.pop(peer, None)
        self._kept.pop(peer, None)
        self._ready[peer] = None
        self._schedule()

    def add_silent(self, peer: Peer, *, kept: bool = False) -> None:
        """Add a connection that waits for data, unless it waits for its turn.

        ``kept`` means that it has had a response other than a rejection; it is closed after
        connections without such a response.
        """
        if peer not in self._ready:
            self.discard(peer)
            (self._kept if kept else self._silent)[peer] = None

    def discard(self, peer: Peer) -> None:
        """Remove a connection."""
        self._silent.pop(peer, None)
        self._kept.pop(peer, None)
        self._ready.pop(peer, None)

    def pop_silent(self) -> Peer | None:
        """Remove and return the connection to close to make room; None if all are fresh.

        It is the one that has been silent longest; connections without a response come first.
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
        """Remove and return the last connection of the queue; those before it are served sooner."""
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
    """Return whether data, or the end of the connection, have arrived and can be read."""
    opened = transport.get_extra_info("socket")
    if opened is None or opened.fileno() < 0:
        return False
    poll = select.poll()
    poll.register(opened.fileno(), select.POLLIN)
    return bool(poll.poll(0))


# Event loop whose turns have a bounded number of socket events. asyncio handles all sockets that
# are ready before anything else. If a client closes 500 connections at once, that is one turn of a
# tenth of a second, while a stop takes about ten turns.

EVENTS = 24
"""Largest number of socket events of one turn; the others are handled in the next turns."""


class BoundedSelector(selectors.DefaultSelector):
    """Selector that returns at most ``EVENTS`` events, of all ready sockets in rotation."""

    _place = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for events; sockets that are left out are still ready at the next call."""
        ready = super().select(timeout)
        if len(ready) <= EVENTS:
            return ready
        begin = self._place % len(ready)
        self._place = begin + EVENTS
        return (ready[begin:] + ready[:begin])[:EVENTS]


def new_loop() -> asyncio.AbstractEventLoop:
    """Build the event loop of the REST server."""
    return asyncio.SelectorEventLoop(BoundedSelector())


HANDSHAKE_S = 3
"""Time limit of the first message of a handshake, and also of the remaining handshake, in s."""
MOST_PENDING = 600
"""Largest number of connections with an incomplete handshake."""
HANDSHAKE = b"\x16\x03"
"""First bytes of TLS: a handshake record of version 3."""
HEAD_BYTES = 5
"""Size of a record's header; its last two bytes are the length of its content."""
PLAIN = b"this supervisor speaks TLS: ask for https://\n"
BAD_REQUEST = b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"


def server_context(credentials: Credentials) -> ssl.SSLContext:
    """Return a TLS context (1.2 or later) with the supervisor's certificate.

    Clients authenticate by keys.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(credentials.certificate, credentials.private_key)
    return context


class Doorway(asyncio.Protocol):
    """A connection before and during its handshake; later it uses the protocol ``connection``.

    ``queue`` is shared by all handshakes of a server.
    """

    transport: asyncio.Transport
    _until: asyncio.TimerHandle

    def __init__(
        self,
        context: ssl.SSLContext,
        queue: WorkQueue,
        connection: Callable[..., asyncio.Protocol],
        **given: Any,
    ) -> None:
        self._context, self._queue = context, queue
        self._connection = partial(connection, **given)
        self._first = b""

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]  as asyncio calls it
        """Wait for the first message of a handshake; if there are too many connections, close one
        of the others.
        """
        self.transport = transport
        if len(self._queue) >= MOST_PENDING:
            other = self._queue.pop_silent() or self._queue.pop_last()
            if other is not None:
                other.abort()
        self._queue.add_silent(self)
        self._until = asyncio.get_running_loop().call_later(HANDSHAKE_S, self.abort)

    def data_received(self, data: bytes) -> None:
        """Enqueue the handshake once its first message is complete; reject plain HTTP."""
        self._first += data
        if self._first[:2] != HANDSHAKE[: len(self._first)]:
            self.transport.write(BAD_REQUEST + PLAIN)
            self.transport.close()
            return
        size = HEAD_BYTES + int.from_bytes(self._first[3:HEAD_BYTES], "big")
        if len(self._first) >= max(size, HEAD_BYTES + 1):
            self._until.cancel()
            self.transport.pause_reading()
            self._queue.add(self)

    def work(self) -> bool:
        """Begin the handshake; most of its cost is in this call."""
        loop = asyncio.get_running_loop()
        done: asyncio.Future[None] = loop.create_future()
        done.add_done_callback(self._shaken)
        # Same as loop.start_tls, but without its tasks, which take several turns of the loop.
        tls = SSLProtocol(
            loop,
            self._connection(),
            self._context,
            done,
            server_side=True,
            ssl_handshake_timeout=HANDSHAKE_S,
        )
        self._queue.add_silent(self)
        self.transport.set_protocol(tls)
        tls.connection_made(self.transport)
        _feed(tls, self._first)
        self.transport.resume_reading()
        return False

    def _shaken(self, done: "asyncio.Future[None]") -> None:
        self._forget()
        if not done.cancelled():
            done.exception()  # retrieve the error, which the client has caused

    def has_unread_data(self) -> bool:
        """Return whether the first message of the handshake has arrived."""
        return has_data(self.transport)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002  asyncio's name
        """Remove the connection from the queue."""
        self._forget()

    def abort(self) -> None:
        """Close the connection."""
        self._forget()
        self.transport.abort()

    def _forget(self) -> None:
        self._until.cancel()
        self._queue.discard(self)


def _feed(protocol: asyncio.BufferedProtocol, data: bytes) -> None:
    """Feed bytes to a protocol as its transport does."""
    while data:
        buffer = memoryview(protocol.get_buffer(len(data)))
        size = min(len(buffer), len(data))
        buffer[:size] = data[:size]
        protocol.buffer_updated(size)
        data = data[size:]
