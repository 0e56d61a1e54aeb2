"""TLS of the REST server: a connection is one of the server's once its handshake is done.

asyncio would begin a handshake with all who connect, however many, and wait for each for a minute.
Here one begins when its first message is there, which has three seconds, and so has the rest; of
more than 128 the oldest goes, as at the ports of the bus. A stranger who says nothing costs little.
"""

import asyncio
import ssl
from collections.abc import Callable
from typing import cast

from pincette.security.identity import Credentials

HANDSHAKE_S = 3.0
"""For the first message of a handshake, and for all that follows."""
MOST_PENDING = 128
"""Connections whose handshake is not done."""
HANDSHAKE = b"\x16\x03"
"""How it begins: a record of that type, of version 3."""
HEAD_BYTES = 5
"""Of a record; its last two bytes are the length of what follows."""
PLAIN = b"this supervisor speaks TLS: ask for https://\n"
BAD_REQUEST = b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"


def server_context(credentials: Credentials) -> ssl.SSLContext:
    """TLS 1.2 or later with the supervisor's certificate; callers prove themselves by keys."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(credentials.certificate, credentials.private_key)
    return context


class Early(asyncio.Protocol):
    """Keeps what comes between the end of a handshake and the begin of the connection."""

    def __init__(self) -> None:
        self.data = b""
        self.ended = False

    def data_received(self, data: bytes) -> None:
        """Keep it."""
        self.data += data

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002  asyncio's name
        """Note that nobody is there any more."""
        self.ended = True


class Doorway(asyncio.Protocol):
    """A connection that shakes hands, and is then what ``connection`` makes."""

    _transport: asyncio.Transport
    _until: asyncio.TimerHandle
    _shaking: "asyncio.Task[None] | None" = None

    def __init__(
        self,
        context: ssl.SSLContext,
        pending: "dict[Doorway, None]",
        connection: Callable[[], asyncio.Protocol],
    ) -> None:
        self._context, self._pending, self._connection = context, pending, connection
        self._first = b""

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]  as asyncio calls it
        """Wait for a handshake, at the cost of the oldest one where there are too many."""
        self._transport = transport
        if len(self._pending) >= MOST_PENDING:
            next(iter(self._pending)).abort()
        self._pending[self] = None
        self._until = asyncio.get_running_loop().call_later(HANDSHAKE_S, self.abort)

    def data_received(self, data: bytes) -> None:
        """Begin the handshake once its first message is whole; tell one who speaks plain HTTP."""
        self._first += data
        if self._first[:2] != HANDSHAKE[: len(self._first)]:
            self._transport.write(BAD_REQUEST + PLAIN)
            self._transport.close()
            return
        size = HEAD_BYTES + int.from_bytes(self._first[3:HEAD_BYTES], "big")
        if len(self._first) >= max(size, HEAD_BYTES + 1):
            self._until.cancel()
            self._transport.pause_reading()
            self._shaking = asyncio.get_running_loop().create_task(self._shake())

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002  asyncio's name
        """Forget it."""
        self._forget()

    def abort(self) -> None:
        """End it."""
        self._forget()
        self._transport.abort()

    def _forget(self) -> None:
        self._until.cancel()
        self._pending.pop(self, None)

    async def _shake(self) -> None:
        early = Early()
        loop = asyncio.get_running_loop()
        begun = loop.create_task(
            loop.start_tls(
                self._transport,
                early,
                self._context,
                server_side=True,
                ssl_handshake_timeout=HANDSHAKE_S,
            )
        )
        # From when on it reads: what is known already comes before all that is still to come.
        while not (self._transport.is_reading() or begun.done()):
            await asyncio.sleep(0)
        if not begun.done():
            _feed(cast("asyncio.BufferedProtocol", self._transport.get_protocol()), self._first)
        try:
            shaken = await begun
        except OSError:  # no handshake, none in time, or ended to make room
            self._transport.abort()
            return
        finally:
            self._forget()
        if shaken is None or early.ended:
            return
        connection = self._connection()
        shaken.set_protocol(connection)
        connection.connection_made(shaken)
        if early.data:
            connection.data_received(early.data)


def _feed(protocol: asyncio.BufferedProtocol, data: bytes) -> None:
    """Hand bytes to a protocol as its transport does."""
    while data:
        buffer = memoryview(protocol.get_buffer(len(data)))
        size = min(len(buffer), len(data))
        buffer[:size] = data[:size]
        protocol.buffer_updated(size)
        data = data[size:]
