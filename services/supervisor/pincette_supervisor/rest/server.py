"""The HTTP server: its connections, and which of them make room for others."""

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
"""Connections; each is an open file, of which the program has 4096 where the system allows it."""
HEAD_S = 10.0
"""Time from the first byte of a request to the end of its head."""
HEAD_BYTES = 16_384
"""Largest size of a head; a longer one is refused with 400."""
HEADERS_MAX = 100
"""Headers of a request; more are refused with 431."""
SLICE_BYTES, CHUNKED_BYTES = 2048, 256
"""Bytes of one connection that are processed before others have their turn; fewer of a chunked
body, of which each chunk takes some 7 µs, however small it is."""
LINE_BYTES = 512
"""Bytes of a request in which its line is looked for, to serve a stop first."""
REQUEST_BYTES = 1_048_576
"""Bytes of one request on the wire, of which the framing of tiny chunks may be the most."""
DRAINED_BYTES = 65_536
"""Largest body that is still read after an answer that came before its end. Clients that send head
and body in two writes use the connection again; without this their next request would fail."""
PIPELINED_S = 0.5
"""Time from an answer to the next request of a client that has not waited for the answer."""
LINGER_S = 2.0
"""Time in which a client can read an answer that came before the end of its body."""
TOO_MANY_HEADERS = (
    b"HTTP/1.1 431 Request Header Fields Too Large\r\nContent-Type: text/plain\r\n"
    b"Connection: close\r\n\r\nmore than %d headers: send fewer\n" % HEADERS_MAX
)
NOT_HTTP = (
    b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"
    b"Invalid HTTP request received.\n"
)
ACCEPT_BATCH = 16
"""Connections accepted in one turn of the event loop; asyncio takes its ``backlog`` for that."""
BACKLOG = 1024
"""Connections that wait in the system to be accepted."""
KEEP_S = 75
"""An idle connection is kept for longer than clients do, or a request crosses with its end."""
STOP_S = 2
WORKERS = 6
"""Threads that work out answers; an emergency stop needs none of them. They take turns with the
thread that reads requests, which waits for all of them each time it has something to do."""


class SlicedReading(FlowControl):
    """Flow control that first processes what the connection has received already."""

    def __init__(self, transport: asyncio.Transport, process: Callable[[], None]) -> None:
        super().__init__(transport)
        self._process = process

    def resume_reading(self) -> None:
        """Go on with the connection's data."""
        if self.read_paused:
            self.read_paused = False
            self._process()


class Connection(H11Protocol):
    """One connection. While nothing is asked over it, it makes room for others, the oldest first.

    So a flood of connections shuts nobody out: whoever comes in order to stop the rig finds one.
    ``limit_concurrency`` of uvicorn would refuse by number alone, whoever comes.

    Data are processed in slices, which wait for their turn in a queue of all connections. Only the
    data of a stop are processed as soon as they arrive.
    """

    _head: asyncio.TimerHandle | None = None
    _head_data = b""
    """Data of the request whose head is being read, to recognise a stop that is no valid HTTP."""
    _lingers = False
    _size = _lines = 0
    _is_stop = False
    """Whether the request that is being read or answered stops a rig or a job."""
    _was_served = False
    """True after the first request of this connection that was not refused."""

    def __init__(self, queue: WorkQueue, refusals: Refusals, **given: Any) -> None:
        super().__init__(**given)
        self._queue, self._refusals = queue, refusals
        self._received = bytearray()

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]  as in uvicorn
        """Take a connection, at the cost of another one where there are too many."""
        super().connection_made(transport)
        self.flow = SlicedReading(transport, self._go_on)
        self._await_head()
        self._note_silent()
        if len(self.connections) > MOST:
            other = self._queue.pop_silent() or self._held() or self._queue.pop_last()
            if other is not None:
                other.abort()

    def _held(self) -> "Connection | None":
        """Return a connection whose request is refused, and whose answer is being held back."""
        others = cast("set[Connection]", self.connections)
        return next((one for one in others if one.is_held), None)

    @property
    def is_held(self) -> bool:
        """Whether the answer is a refusal that is being held back."""
        return not self.idle and HELD in self.scope

    def _note_silent(self) -> None:
        self._queue.add_silent(self, kept=self._was_served)

    @property
    def idle(self) -> bool:
        """Whether nothing is being answered."""
        cycle = cast("RequestResponseCycle | None", self.cycle)  # None until there is one
        return cycle is None or cycle.response_complete

    def data_received(self, data: bytes) -> None:
        """Process data of a stop at once; all others wait for their turn."""
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
        """Process one slice or a pipelined request; returns whether a request has begun."""
        begun = len(self.tasks)
        if self.idle and self.conn.our_state is h11.DONE and not self._drains():
            super().on_response_complete()
        else:
            self._process()
        return len(self.tasks) > begun

    def _process(self) -> None:
        """Process one slice, and enqueue the rest."""
        if not self._received or self.flow.read_paused:  # empty data mean the end to h11
            return
        if self.is_held:  # the answer is settled, and resumes reading
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
        """Enqueue what has been received, or else read again."""
        if self._received and not self._lingers:
            self._enqueue()
        else:
            self.transport.resume_reading()

    def _has_too_many_headers(self, data: bytes) -> bool:
        """Whether a head is too long before its end is seen; a stop is parsed however long."""
        ends = b"\n\r\n" in data or b"\n\n" in data
        self._lines = 0 if ends else self._lines + data.count(b"\n")
        return self._lines > HEADERS_MAX and not self._is_stop

    def eof_received(self) -> bool:  # pyright: ignore[reportIncompatibleMethodOverride]  as in asyncio
        """Keep a connection whose client has sent its stop and closed its side, to answer it."""
        if not self._is_stop or self.idle or self.scheme == "https":  # TLS has no half-closed state
            return False
        self.cycle.keep_alive = False
        return True

    def send_400_response(self, msg: str) -> None:  # noqa: ARG002  uvicorn's name
        """Refuse what is no valid HTTP, except an emergency stop, for example without ``Host``."""
        estop = estop_of_malformed(self._head_data)
        if estop is None:
            if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
                self._refuse(NOT_HTTP)
            else:  # in the middle of an answer, or after the last one
                self.transport.close()
            return
        self._head_data = b""
        self.conn = h11.Connection(h11.SERVER)  # the old one accepts nothing more
        super().data_received(estop)

    def on_response_complete(self) -> None:
        """Wait for the next request, or end where a long body of this one has not been read."""
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
        """Whether the request has been answered and its body has not come to its end."""
        return self.idle and self.conn.their_state is h11.SEND_BODY

    def _length(self) -> int | None:
        """Return the length of the body by its header; None where the body is chunked."""
        length = dict(self.scope["headers"]).get(b"content-length", b"")
        return int(length) if length.isdigit() else None

    def _refuse(self, answer: bytes) -> None:
        """Send an answer that ends the connection, at once or held back."""
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
        """End the connection; ignore what comes until the client has read its answer."""
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
        """Return whether a request has arrived; what comes after a last answer is ignored."""
        return not self._lingers and has_data(self.transport)

    def abort(self) -> None:
        """End the connection at once."""
        self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
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
    """Refuses a request with two lengths, and ends its connection.

    Programs before this one may believe the other length, and take the rest for a request of
    somebody else (RFC 9112, section 6.1).
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 400 where both lengths are told; else pass the request on."""
        estop = estop_path(scope["method"], scope["path"]) if scope["type"] == "http" else None
        if scope["type"] == "http" and len(scope["headers"]) > HEADERS_MAX and estop is None:
            await self._refuse(send, 431, f"more than {HEADERS_MAX} headers: send fewer\n")
            return
        names = {name for name, _ in scope.get("headers", ())}
        if scope["type"] != "http" or not names >= {b"content-length", b"transfer-encoding"}:
            await self._app(scope, receive, send)
            return
        if estop is not None:
            # It needs no body, so it is done; what follows on the connection is not read.
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
    """Send a response whose connection ends with it."""
    if message["type"] == "http.response.start":
        message["headers"] = [*message["headers"], (b"connection", b"close")]
    await send(message)


class Server(uvicorn.Server):
    """Works out as many answers at once as leave an emergency stop its turn."""

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Begin to serve."""
        current_default_thread_limiter().total_tokens = WORKERS
        for listener in sockets or ():
            # Connections inherit it. asyncio sets it on sockets of protocol IPPROTO_TCP alone, and
            # uvicorn's have 0: each body then waited 40 ms for the client's acknowledgement.
            listener.setsockopt(IPPROTO_TCP, TCP_NODELAY, 1)
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(BACKLOG)


def server_of(app: ASGIApp, tls: ssl.SSLContext | None = None) -> uvicorn.Server:
    """The server of an application; nothing of a request is logged, least of all its head."""
    refusals = Refusals()
    door: Any = partial(Connection, WorkQueue(), refusals)
    if tls is not None:
        # A handshake must precede a stop. So this queue has no breaks, and the newest handshake
        # does not wait for all of a flood.
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
