"""TLS of the REST server: a connection is one of the server's once its handshake is done.

asyncio would begin a handshake with each client at once, and wait a minute for it. Here a handshake
begins when its first message has arrived, and each turn of the event loop begins a few, so that a
flood of handshakes does not stop the loop. A client has three seconds for its first message, and
three for the rest. At most 600 handshakes are pending.
"""

import asyncio
import ssl
from asyncio.sslproto import SSLProtocol
from collections.abc import Callable
from functools import partial
from typing import Any

from pincette.security.identity import Credentials
from pincette_supervisor.rest.work_queue import WorkQueue, has_data

HANDSHAKE_S = 3
"""Time limits of the first message of a handshake, and of all that follows."""
MOST_PENDING = 600
"""Largest number of connections whose handshake is not complete."""
HANDSHAKE = b"\x16\x03"
"""First bytes of TLS: a record of that type, of version 3."""
HEAD_BYTES = 5
"""Size of a record's head; its last two bytes are the length of what follows."""
PLAIN = b"this supervisor speaks TLS: ask for https://\n"
BAD_REQUEST = b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"


def server_context(credentials: Credentials) -> ssl.SSLContext:
    """TLS 1.2 or later with the supervisor's certificate; callers prove themselves by keys."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(credentials.certificate, credentials.private_key)
    return context


class Doorway(asyncio.Protocol):
    """A connection before and during its handshake; afterwards it has the protocol ``connection``.

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
        """Wait for a handshake, at the cost of another one where there are too many."""
        self.transport = transport
        if len(self._queue) >= MOST_PENDING:
            other = self._queue.pop_silent() or self._queue.pop_last()
            if other is not None:
                other.abort()
        self._queue.add_silent(self)
        self._until = asyncio.get_running_loop().call_later(HANDSHAKE_S, self.abort)

    def data_received(self, data: bytes) -> None:
        """Enqueue the handshake once its first message is whole; refuse plain HTTP."""
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
        # As loop.start_tls does, without its tasks, which take several turns of the loop.
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
            done.exception()  # of the client's making; the connection is ended

    def has_unread_data(self) -> bool:
        """Return whether the first message of the handshake is there."""
        return has_data(self.transport)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002  asyncio's name
        """Forget it."""
        self._forget()

    def abort(self) -> None:
        """End it."""
        self._forget()
        self.transport.abort()

    def _forget(self) -> None:
        self._until.cancel()
        self._queue.discard(self)


def _feed(protocol: asyncio.BufferedProtocol, data: bytes) -> None:
    """Hand bytes to a protocol as its transport does."""
    while data:
        buffer = memoryview(protocol.get_buffer(len(data)))
        size = min(len(buffer), len(data))
        buffer[:size] = data[:size]
        protocol.buffer_updated(size)
        data = data[size:]
