"""The HTTP server: its connections, and which of them are closed to make room for others."""

import asyncio
import ssl
from collections.abc import Callable
from functools import partial
from socket import IPPROTO_TCP, TCP_NODELAY, socket
from typing import Any, cast

import h11
import uvicorn
from anyio.to_thread import current_default_thread_limiter
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.flow_control import FlowControl
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from pincette_supervisor.rest.connections import Doorway, WorkQueue, has_data, new_loop
from pincette_supervisor.rest.dependencies import HELD
from pincette_supervisor.rest.limits import (
    REFUSED,
    HeldRefusals,
    Refusals,
    estop_of_malformed,
    estop_path,
    is_stop,
)

MOST = 600
"""Largest number of connections; each is an open file, of which the program has 4096 if the system
permits."""
HEAD_S = 10.0
"""Longest time from the first byte of a request to the end of its head, in s."""
HEAD_BYTES = 16_384
"""Largest size of a head, in bytes; a longer one is rejected with 400."""
HEADERS_MAX = 100
"""Largest number of headers of a request; more are rejected with 431."""
SLICE_BYTES, CHUNKED_BYTES = 2048, 256
"""Number of bytes of one connection that are processed before other connections have their turn;
fewer for a chunked body, since each chunk takes some 7 µs even if it is tiny."""
LINE_BYTES = 512
"""Number of bytes of a request in which its first line is searched, to serve a stop first."""
REQUEST_BYTES = 1_048_576
"""Largest size of one request on the wire, in bytes; the framing of tiny chunks may take most of
it."""
DRAINED_BYTES = 65_536
"""Largest body that is still read after a response that preceded its end.

Clients that send head and body in two writes reuse the connection, and without this their next
request would fail.
"""
PIPELINED_S = 0.5
"""Time from a response to the next request of a client that did not wait for the response, in s."""
LINGER_S = 2.0
"""Time in which a client can read a response that preceded the end of its body, in s."""
TOO_MANY_HEADERS = (
    b"HTTP/1.1 431 Request Header Fields Too Large\r\nContent-Type: text/plain\r\n"
    b"Connection: close\r\n\r\nmore than %d headers: send fewer\n" % HEADERS_MAX
)
NOT_HTTP = (
    b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"
    b"Invalid HTTP request received.\n"
)
ACCEPT_BATCH = 16
"""Connections accepted in one turn of the event loop; asyncio uses its ``backlog`` for that."""
BACKLOG = 1024
"""Number of connections that the system queues until they are accepted."""
KEEP_S = 75
"""Time for which an idle connection is kept, in s.

It is longer than that of clients; otherwise the server could close a connection while a client
sends its next request.
"""
STOP_S = 2
WORKERS = 6
"""Threads that compute responses; an emergency stop needs none of them.

The thread that reads requests competes with all of them each time it has work to do.
"""


class SlicedReading(FlowControl):
    """Flow control that first processes the data that the connection has already received."""

    def __init__(self, transport: asyncio.Transport, process: Callable[[], None]) -> None:
        super().__init__(transport)
        self._process = process

    def resume_reading(self) -> None:
        """Continue with the connection's data."""
        if self.read_paused:
            self.read_paused = False
            self._process()


class Connection(H11Protocol):
    """One connection. An idle connection can be closed to make room for others, the oldest first.

    Therefore many connections cannot block a client that wants to stop the rig.
    ``limit_concurrency`` of uvicorn would reject connections by number alone.

    Data are processed in slices, which wait for their turn in a queue of all connections. Only the
    data of a stop are processed as soon as they arrive.
    """

    _head: asyncio.TimerHandle | None = None
    _head_data = b""
    """Data of the request whose head is being read, to recognise a stop that is invalid HTTP."""
    _lingers = False
    _size = _lines = 0
    _is_stop = False
    """True if the request that is being read or answered stops a rig or a job."""
    _was_served = False
    """True after the first request of this connection that was not rejected."""

    def __init__(self, queue: WorkQueue, refusals: Refusals, **given: Any) -> None:
        super().__init__(**given)
        self._queue, self._refusals = queue, refusals
        self._received = bytearray()

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]  as in uvicorn
        """Accept a connection; close another one if there are too many."""
        super().connection_made(transport)
        self.flow = SlicedReading(transport, self._go_on)
        self._await_head()
        self._note_silent()
        if len(self.connections) > MOST:
            other = self._queue.pop_silent() or self._held() or self._queue.pop_last()
            if other is not None:
                other.abort()

    def _held(self) -> "Connection | None":
        """Return a connection whose request is rejected and whose response is being delayed."""
        others = cast("set[Connection]", self.connections)
        return next((one for one in others if one.is_held), None)

    @property
    def is_held(self) -> bool:
        """Return whether the response is a rejection that is being delayed."""
        return not self.idle and HELD in self.scope

    def _note_silent(self) -> None:
        self._queue.add_silent(self, kept=self._was_served)

    @property
    def idle(self) -> bool:
        """Return whether no response is pending."""
        cycle = cast("RequestResponseCycle | None", self.cycle)  # None until there is one
        return cycle is None or cycle.response_complete

    def data_received(self, data: bytes) -> None:
        """Process data of a stop at once; other connections wait for their turn."""
        if self._lingers:
            return
        self._received += data
        if self.flow.read_paused:
            self.transport.pause_reading()
            return
        if self.idle:
            self._is_stop = is_stop(self._head_data + self._received[:LINE_BYTES])
        if self._is_stop:
            self._process()
        else:
            self._enqueue()

    def _enqueue(self) -> None:
        self._queue.add(self)
        if len(self._received) > SLICE_BYTES:
            self.transport.pause_reading()

    def work(self) -> bool:
        """Process one slice or a pipelined request; return whether a request has begun."""
        begun = len(self.tasks)
        if self.idle and self.conn.our_state is h11.DONE and not self._drains():
            super().on_response_complete()
        else:
            self._process()
        return len(self.tasks) > begun

    def _process(self) -> None:
        """Process one slice, and enqueue the rest."""
        if not self._received or self.flow.read_paused:  # h11 takes empty data for the end
            return
        if self.is_held:  # the response is complete, and resumes reading
            self.flow.pause_reading()
            return
        size = SLICE_BYTES if self.idle or self._length() is not None else CHUNKED_BYTES
        data = bytes(self._received[:size])
        del self._received[:size]
        self._size += len(data)
        drains = self._drains()
        if self.idle and not drains and self._has_too_many_headers(data):
            self._refuse(TOO_MANY_HEADERS)
            return
        if self.idle and self.conn.their_state is h11.IDLE:
            self._head_data = (self._head_data + data)[:HEAD_BYTES]
        super().data_received(data)
        if self.transport.is_closing() or self._lingers:
            return
        if drains and not self._drains() and not self.conn.trailing_data[0]:
            self._cancel()
            self._note_silent()
        elif self.idle:
            self._await_head()
            self._note_silent()
        else:
            self._queue.discard(self)
            self._cancel()
        if self._size > REQUEST_BYTES:
            self.abort()
        elif not self.flow.read_paused:
            self._go_on()

    def _go_on(self) -> None:
        """Enqueue the data that has been received, or else resume reading."""
        if self._received and not self._lingers:
            self._enqueue()
        else:
            self.transport.resume_reading()

    def _has_too_many_headers(self, data: bytes) -> bool:
        """Return whether an incomplete head is too long already; a stop is parsed at any length."""
        ends = b"\n\r\n" in data or b"\n\n" in data
        self._lines = 0 if ends else self._lines + data.count(b"\n")
        return self._lines > HEADERS_MAX and not self._is_stop

    def eof_received(self) -> bool:  # pyright: ignore[reportIncompatibleMethodOverride]  as in asyncio
        """Keep a connection whose client has sent a stop and closed its side, to answer it."""
        if not self._is_stop or self.idle or self.scheme == "https":  # TLS has no half-closed state
            return False
        self.cycle.keep_alive = False
        return True

    def send_400_response(self, msg: str) -> None:  # noqa: ARG002  uvicorn's name
        """Reject invalid HTTP, except an emergency stop, for example without ``Host``."""
        estop = estop_of_malformed(self._head_data)
        if estop is None:
            if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
                self._refuse(NOT_HTTP)
            else:  # during a response, or after the last one
                self.transport.close()
            return
        self._head_data = b""
        self.conn = h11.Connection(h11.SERVER)  # the old one accepts no more data
        super().data_received(estop)

    def on_response_complete(self) -> None:
        """Wait for the next request, or close if a long body of this one has not been read."""
        self._head_data = b""
        self._size = self._lines = 0
        self._is_stop = False
        self._was_served |= REFUSED not in self.scope
        if self._drains() and not self.transport.is_closing():
            length = self._length()
            if length is not None and length <= DRAINED_BYTES:
                self._await_head()
                self._note_silent()
                super().on_response_complete()
            else:
                self.server_state.total_requests += 1
                self._linger()
        elif self.conn.trailing_data[0]:
            self.loop.call_later(PIPELINED_S, self._enqueue_pipelined)
        else:
            self._note_silent()
            super().on_response_complete()

    def _enqueue_pipelined(self) -> None:
        if not self.transport.is_closing():
            self._queue.add(self)

    def _drains(self) -> bool:
        """Return whether the request has a response and its body has not ended."""
        return self.idle and self.conn.their_state is h11.SEND_BODY

    def _length(self) -> int | None:
        """Return the length of the body by its header; None if the body is chunked."""
        length = dict(self.scope["headers"]).get(b"content-length", b"")
        return int(length) if length.isdigit() else None

    def _refuse(self, answer: bytes) -> None:
        """Send a response that closes the connection, at once or delayed."""
        hold_s = self._refusals.hold_s("" if self.client is None else self.client[0])
        if hold_s:
            self._lingers = True
            self._received.clear()
            self.transport.pause_reading()
            self._note_silent()
            self.loop.call_later(hold_s, self._end_with, answer)
        else:
            self._end_with(answer)

    def _end_with(self, answer: bytes) -> None:
        if not self.transport.is_closing():
            self.transport.write(answer)
            self._linger()

    def _linger(self) -> None:
        """Close the connection; ignore incoming data until the client has read its response."""
        self._lingers = True
        self._received.clear()
        self._note_silent()
        if not self.transport.can_write_eof():  # TLS
            self.transport.close()
            return
        try:
            self.transport.write_eof()
        except OSError:  # the client has reset the connection
            self.abort()
            return
        self.transport.resume_reading()
        self.loop.call_later(LINGER_S, self.abort)

    def has_unread_data(self) -> bool:
        """Return whether a request has arrived; data after a last response is ignored."""
        return not self._lingers and has_data(self.transport)

    def abort(self) -> None:
        """Close the connection at once."""
        self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection from the queue."""
        self._queue.discard(self)
        self._cancel()
        self._received.clear()
        super().connection_lost(exc)

    def _await_head(self) -> None:
        if self._head is None:
            self._head = self.loop.call_later(HEAD_S, self.abort)

    def _cancel(self) -> None:
        if self._head is not None:
            self._head.cancel()
            self._head = None


class UnambiguousLength:
    """Rejects a request with two lengths, and closes its connection.

    A proxy before this server may use the other length, and treat the rest as a request of another
    client (RFC 9112, section 6.1).
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Respond with 400 to a request with two lengths, and with 431 to one with too many
        headers; otherwise pass the request on.
        """
        estop = estop_path(scope["method"], scope["path"]) if scope["type"] == "http" else None
        if scope["type"] == "http" and len(scope["headers"]) > HEADERS_MAX and estop is None:
            await self._refuse(send, 431, f"more than {HEADERS_MAX} headers: send fewer\n")
            return
        names = {name for name, _ in scope.get("headers", ())}
        if scope["type"] != "http" or not names >= {b"content-length", b"transfer-encoding"}:
            await self._app(scope, receive, send)
            return
        if estop is not None:
            # The response needs no body, so it is complete; later data of the connection is not
            # read.
            await self._app(scope, receive, partial(_send_and_close, send))
            return
        await self._refuse(
            send, 400, "Content-Length and Transfer-Encoding exclude each other: send one\n"
        )

    async def _refuse(self, send: Send, status: int, text: str) -> None:
        headers = [
            (b"content-type", b"text/plain"),
            (b"content-length", b"%d" % len(text)),
            (b"connection", b"close"),
        ]
        await send({"type": "http.response.start", "status": status, "headers": headers})
        await send({"type": "http.response.body", "body": text.encode()})


async def _send_and_close(send: Send, message: Message) -> None:
    """Send a response and close its connection."""
    if message["type"] == "http.response.start":
        message["headers"] = [*message["headers"], (b"connection", b"close")]
    await send(message)


class Server(uvicorn.Server):
    """HTTP server that limits concurrent responses so that an emergency stop gets its turn."""

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Start serving."""
        current_default_thread_limiter().total_tokens = WORKERS
        for listener in sockets or ():
            # Connections inherit this option. asyncio sets it only on sockets of protocol
            # IPPROTO_TCP, and uvicorn's have 0: each body then waited 40 ms for the client's
            # acknowledgement.
            listener.setsockopt(IPPROTO_TCP, TCP_NODELAY, 1)
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(BACKLOG)


def server_of(app: ASGIApp, tls: ssl.SSLContext | None = None) -> uvicorn.Server:
    """Return the server of an application.

    Requests are not logged, in particular not their heads.
    """
    refusals = Refusals()
    door: Any = partial(Connection, WorkQueue(), refusals)
    if tls is not None:
        # A handshake must precede a stop. So this queue has no breaks, and the newest handshake
        # does not wait for all the others.
        door = partial(Doorway, tls, WorkQueue(break_s=0.0, alternates=True), door)
    return Server(
        uvicorn.Config(
            HeldRefusals(UnambiguousLength(app), refusals),
            http=door,
            loop=f"{new_loop.__module__}:{new_loop.__name__}",
            ws="none",
            log_config=None,
            log_level="error",
            access_log=False,
            lifespan="off",
            proxy_headers=False,
            server_header=False,
            backlog=ACCEPT_BATCH,
            h11_max_incomplete_event_size=HEAD_BYTES,
            timeout_keep_alive=KEEP_S,
            timeout_graceful_shutdown=STOP_S,
        )
    )
