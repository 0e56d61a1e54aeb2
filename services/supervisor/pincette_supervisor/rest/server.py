"""The HTTP server: its connections, and which of them make room for others."""

import asyncio
import ssl
from functools import partial
from socket import socket
from typing import Any, cast

import h11
import uvicorn
from anyio.to_thread import current_default_thread_limiter
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from pincette_supervisor.rest.request_target import estop_of_malformed, estop_path
from pincette_supervisor.rest.tls import Doorway

MOST = 384
"""Connections; each is an open file, of which a process usually has 1024."""
HEAD_S = 10.0
"""From the first sign of a request to the end of its head."""
HEAD_BYTES = 16_384
"""Of a head; a longer one is refused with 400."""
KEEP_S = 75
"""An idle connection is kept for longer than clients do, or a request crosses with its end."""
STOP_S = 2
WORKERS = 6
"""Threads that work out answers; an emergency stop needs none of them. They take turns with the
thread that reads requests, which waits for all of them each time it has something to do."""


class Connection(H11Protocol):
    """One connection. While nothing is asked over it, it makes room for others, the oldest first.

    So a flood of connections shuts nobody out: whoever comes in order to stop the rig finds one.
    ``limit_concurrency`` of uvicorn would refuse by number alone, whoever comes.
    """

    _head: asyncio.TimerHandle | None = None
    _head_data = b""
    """Data of the request whose head is being read, to recognise a stop that is no valid HTTP."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]  as in uvicorn
        """Take a connection, at the cost of another one where there are too many."""
        super().connection_made(transport)
        self._await_head()
        quiet = self._quiet
        quiet[self] = None
        # What was ended a moment ago is one of the connections until the loop comes to it.
        if len(self.connections) > MOST and quiet:
            oldest = next(iter(quiet))
            del quiet[oldest]
            oldest.transport.abort()

    @property
    def _quiet(self) -> "dict[Connection, None]":
        """Those of this server over which nothing is asked, the longest so first."""
        return vars(self.server_state).setdefault("quiet", {})

    @property
    def idle(self) -> bool:
        """Whether nothing is being answered."""
        cycle = cast("RequestResponseCycle | None", self.cycle)  # None until there is one
        return cycle is None or cycle.response_complete

    def data_received(self, data: bytes) -> None:
        """Read; what began to ask must come to the point."""
        if self.idle and self.conn.their_state is h11.IDLE:
            self._head_data = (self._head_data + data)[:HEAD_BYTES]
        super().data_received(data)
        if self.idle:
            self._await_head()
        else:
            self._quiet.pop(self, None)
            self._cancel()

    def send_400_response(self, msg: str) -> None:
        """Refuse what is no valid HTTP, except an emergency stop, for example without ``Host``."""
        estop = estop_of_malformed(self._head_data)
        if estop is None:
            super().send_400_response(msg)
            return
        self._head_data = b""
        self.conn = h11.Connection(h11.SERVER)  # the old one accepts nothing more
        super().data_received(estop)

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self._head_data = b""
        self._quiet[self] = None
        super().on_response_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self._quiet.pop(self, None)
        self._cancel()
        super().connection_lost(exc)

    def _await_head(self) -> None:
        if self._head is None:
            self._head = self.loop.call_later(HEAD_S, self.transport.abort)

    def _cancel(self) -> None:
        if self._head is not None:
            self._head.cancel()
            self._head = None


class UnambiguousLength:
    """Refuses a request with two lengths, and ends its connection.

    Programs before this one may believe the other length, and take the rest for a request of
    somebody else (RFC 9112, section 6.1).
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 400 where both lengths are told; else pass the request on."""
        names = {name for name, _ in scope.get("headers", ())}
        if scope["type"] != "http" or not names >= {b"content-length", b"transfer-encoding"}:
            await self._app(scope, receive, send)
            return
        if estop_path(scope["method"], scope["path"]) is not None:
            # It needs no body, so it is done; what follows on the connection is not read.
            await self._app(scope, receive, partial(_send_and_close, send))
            return
        text = b"Content-Length and Transfer-Encoding exclude each other\n"
        headers = [
            (b"content-type", b"text/plain"),
            (b"content-length", b"%d" % len(text)),
            (b"connection", b"close"),
        ]
        await send({"type": "http.response.start", "status": 400, "headers": headers})
        await send({"type": "http.response.body", "body": text})


async def _send_and_close(send: Send, message: Message) -> None:
    """Send a response whose connection ends with it."""
    if message["type"] == "http.response.start":
        message["headers"] = [*message["headers"], (b"connection", b"close")]
    await send(message)


class Server(uvicorn.Server):
    """Works out as many answers at once as leave an emergency stop its turn."""

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Begin to serve."""
        current_default_thread_limiter().total_tokens = WORKERS
        await super().startup(sockets)


def _doorway(tls: ssl.SSLContext, pending: dict[Doorway, None], **given: Any) -> Doorway:
    """What takes the part of a connection until its handshake is done."""
    return Doorway(tls, pending, partial(Connection, **given))


def server_of(app: ASGIApp, tls: ssl.SSLContext | None = None) -> uvicorn.Server:
    """The server of an application; nothing of a request is logged, least of all its head."""
    door: Any = Connection if tls is None else partial(_doorway, tls, {})
    return Server(
        uvicorn.Config(
            UnambiguousLength(app),
            http=door,
            ws="none",
            log_config=None,
            log_level="warning",
            access_log=False,
            lifespan="off",
            proxy_headers=False,
            server_header=False,
            h11_max_incomplete_event_size=HEAD_BYTES,
            timeout_keep_alive=KEEP_S,
            timeout_graceful_shutdown=STOP_S,
        )
    )
