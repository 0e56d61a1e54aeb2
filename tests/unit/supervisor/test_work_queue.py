"""The order in which the HTTP server processes data that many connections have sent at once."""

import asyncio
import selectors
import socket
from collections.abc import Awaitable, Callable
from time import sleep
from typing import Any

import pytest
import uvicorn
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

from pincette_supervisor.rest import limits, server
from pincette_supervisor.rest.connections import EVENTS, TASKS, BoundedSelector, WorkQueue
from pincette_supervisor.rest.limits import Refusals
from pincette_supervisor.rest.server import MOST, server_of

MANY = 300
"""Connections whose data arrive before those of the stop."""
FIRST = 6
"""Most requests of others that may begin before the stop, of all that have arrived."""
WORK_S = 0.001
"""Work of each request on the event loop."""
ESTOP = b"POST /api/v1/rigs/demo/estop HTTP/1.1\r\nHost: a\r\nContent-Length: 0\r\n\r\n"
JOB_STOP = b"POST /api/v1/jobs/job-1/actions HTTP/1.1\r\nHost: a\r\nContent-Length: 0\r\n\r\n"
GET = b"GET /livez HTTP/1.1\r\nHost: a\r\n\r\n"


class Line(asyncio.Transport):
    """A transport that stores what is written."""

    def __init__(self, opened: socket.socket | None = None) -> None:
        ends = {"peername": ("127.0.0.1", 1), "sockname": ("127.0.0.1", 2)}
        super().__init__({**ends, "socket": opened})
        self.sent, self.closed, self.paused = b"", False, False

    def write(self, data: Any) -> None:
        self.sent += bytes(data)

    def close(self) -> None:
        self.closed = True

    abort = close

    def is_closing(self) -> bool:
        return self.closed

    def can_write_eof(self) -> bool:
        return False

    def pause_reading(self) -> None:
        self.paused = True

    def resume_reading(self) -> None:
        self.paused = False


class Lines:
    """Connections of one server, whose application notes the order of the requests."""

    def __init__(self) -> None:
        self.begun: list[str] = []

        async def app(scope: Scope, _receive: Receive, send: Send) -> None:
            self.begun.append(scope["path"])
            sleep(WORK_S)
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b""})

        self._server: uvicorn.Server = server_of(app)
        self._state = ServerState()
        self._peers: list[Any] = []

    def connect(self, opened: socket.socket | None = None) -> tuple[Any, Line]:
        """Open a connection; returns its protocol and its transport."""
        make: Any = self._server.config.http
        protocol, line = (
            make(config=self._server.config, server_state=self._state, app_state={}),
            Line(opened),
        )
        protocol.connection_made(line)
        self._peers.append(protocol)
        return protocol, line

    async def close(self) -> None:
        """Lose all connections, and wait for the requests that have begun."""
        for protocol in self._peers:
            if protocol in self._state.connections:
                protocol.connection_lost(ConnectionResetError())
        await asyncio.gather(*self._state.tasks)


def run(test: Callable[[Lines], Awaitable[None]]) -> None:
    async def begin() -> None:
        lines = Lines()
        await test(lines)
        await lines.close()

    asyncio.run(begin())


async def until(there: Callable[[], bool]) -> None:
    async with asyncio.timeout(30.0):
        while not there():
            await asyncio.sleep(0.0)


def flood(lines: Lines, pieces: bytes = GET) -> list[Line]:
    """Let many connections receive data in one turn of the event loop."""
    peers = [lines.connect() for _ in range(MANY)]
    for protocol, _ in peers:
        protocol.data_received(pieces)
    return [line for _, line in peers]


@pytest.mark.parametrize("request_", [ESTOP, JOB_STOP, ESTOP.replace(b"estop", b"EStop/")])
@pytest.mark.parametrize("pieces", [1, 2, 9])
def test_a_stop_overtakes_earlier_requests(request_: bytes, pieces: int) -> None:
    async def test(lines: Lines) -> None:
        flood(lines)
        protocol, line = lines.connect()
        step = -(-len(request_) // pieces)
        for place in range(0, len(request_), step):
            protocol.data_received(request_[place : place + step])
        await until(lambda: line.sent.startswith(b"HTTP/1.1 200 "))
        assert lines.begun.index(request_.split()[1].decode()) <= FIRST

    run(test)


def test_all_requests_are_answered_in_the_order_of_their_arrival() -> None:
    async def test(lines: Lines) -> None:
        protocol, line = lines.connect()
        protocol.data_received(GET.replace(b"livez", b"first"))
        others = flood(lines, GET * 2)
        await until(lambda: all(one.sent.count(b"HTTP/1.1 200 ") == 2 for one in others))
        assert lines.begun[0] == "/first"
        assert line.sent.count(b"HTTP/1.1 200 ") == 1

    run(test)


def test_requests_are_served_during_a_flood_of_stops() -> None:
    async def test(lines: Lines) -> None:
        protocol, line = lines.connect()
        protocol.data_received(GET)
        flood(lines, ESTOP)
        await until(lambda: line.sent.startswith(b"HTTP/1.1 200 "))
        await until(lambda: len(lines.begun) == MANY + 1)

    run(test)


def test_a_stop_acts_although_its_client_disconnects_at_once() -> None:
    async def test(lines: Lines) -> None:
        flood(lines)
        protocol, _ = lines.connect()
        protocol.data_received(ESTOP)
        protocol.connection_lost(ConnectionResetError())
        await until(lambda: "/api/v1/rigs/demo/estop" in lines.begun)

    run(test)


def test_a_stop_is_answered_although_its_client_has_closed_its_side() -> None:
    async def test(lines: Lines) -> None:
        protocol, line = lines.connect()
        protocol.data_received(ESTOP)
        assert protocol.eof_received() is True
        await until(lambda: line.closed)
        assert line.sent.startswith(b"HTTP/1.1 200 ")

    run(test)


def test_an_error_in_one_connection_does_not_end_the_others() -> None:
    async def test(lines: Lines) -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _loop, _context: None)
        broken, _ = lines.connect()
        broken.data_received(GET)
        sound, broken.conn = broken.conn, None
        others = flood(lines)
        await until(lambda: all(one.sent.startswith(b"HTTP/1.1 200 ") for one in others))
        broken.conn = sound

    run(test)


def test_connections_that_were_served_outlive_silent_ones() -> None:
    """A client that keeps its connection does not lose it to a flood of silent connections."""

    async def test(lines: Lines) -> None:
        kept, line = lines.connect()
        kept.data_received(GET)
        await until(lambda: line.sent.startswith(b"HTTP/1.1 200 "))
        silent = [lines.connect()[1] for _ in range(2 * MOST)]
        assert sum(one.closed for one in silent) > MOST // 2
        assert not line.closed

    run(test)


def test_a_connection_whose_data_have_arrived_outlives_newer_ones() -> None:
    """A new client does not lose its connection before its first request has been read."""

    async def test(lines: Lines) -> None:
        server_end, client_end = socket.socketpair()
        with server_end, client_end:
            client_end.send(GET)
            _, line = lines.connect(server_end)
            silent = [lines.connect()[1] for _ in range(2 * MOST)]
            assert sum(one.closed for one in silent) > MOST // 2
            assert not line.closed

    run(test)


def test_connections_that_wait_for_a_delayed_refusal_are_closed_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Refusals that are held back do not let the number of connections grow."""
    monkeypatch.setattr(server, "Refusals", lambda: Refusals(per_s=1e-3, burst=0.0))
    monkeypatch.setattr(limits, "REFUSAL_HELD_S", 3600.0)

    async def test(lines: Lines) -> None:
        refused = [lines.connect() for _ in range(MOST)]
        for protocol, _ in refused:
            protocol.data_received(b"no HTTP\r\n\r\n")
        await until(lambda: all(line.paused for _, line in refused))
        later = [lines.connect()[1] for _ in range(10)]
        assert [line.closed for _, line in refused[:10]] == [True] * 10
        assert not any(line.closed for line in later)

    run(test)


def test_the_event_loop_handles_a_limited_number_of_sockets_at_a_time_and_none_is_starved() -> None:
    selector, lines = BoundedSelector(), [socket.socketpair() for _ in range(3 * EVENTS)]
    try:
        for reader, writer in lines:
            selector.register(reader, selectors.EVENT_READ)
            writer.send(b"x")
        seen: set[Any] = set()
        for _ in range(3):
            ready = selector.select(0.0)
            assert len(ready) == EVENTS
            seen |= {key.fileobj for key, _ in ready}
        assert seen == {reader for reader, _ in lines}
    finally:
        selector.close()
        for reader, writer in lines:
            reader.close()
            writer.close()


def test_the_work_queue_yields_to_other_tasks_of_the_event_loop() -> None:
    """A stop that needs several turns of the event loop has most of them between two of these."""

    async def test(lines: Lines) -> None:
        flood(lines)
        turns = 0
        while len(lines.begun) < MANY:
            turns += 1
            await asyncio.sleep(0.0)
        assert turns > 3 * MANY / TASKS

    run(test)


@pytest.mark.parametrize(("alternates", "order"), [(False, [0, 1, 2, 3]), (True, [3, 0, 2, 1])])
def test_handshakes_are_started_with_the_oldest_and_the_newest_connection_in_turn(
    alternates: bool, order: list[int]
) -> None:
    begun: list[int] = []

    class Numbered:
        def __init__(self, number: int) -> None:
            self.number = number

        def work(self) -> bool:
            begun.append(self.number)
            return False

        def has_unread_data(self) -> bool:
            return False

        def abort(self) -> None:
            raise AssertionError

    async def test() -> None:
        queue = WorkQueue(break_s=0.0, alternates=alternates)
        for number in range(4):
            queue.add(Numbered(number))
        await until(lambda: len(begun) == 4)

    asyncio.run(test())
    assert begun == order
