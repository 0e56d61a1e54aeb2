"""A request that is refused before its body has come leaves the connection usable.

Clients send head and body in two writes and use the connection again after the answer.
"""

import socket
from collections.abc import Generator

import pytest

from tests.support.rigs import demo_rig
from tests.support.served import HOST, served

from .harness import Harness

HEAD = b"POST /api/v1/nothing HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
NEXT = b"GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
LINES = 300
"""More header lines than are allowed."""


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Generator[socket.socket]:
    harness = Harness(demo_rig(time="lockstep"), tmp_path_factory.mktemp("data"))
    with served(harness.app) as address:
        port = int(address.rpartition(":")[2])
        with socket.create_connection((HOST, port), timeout=30.0) as opened:
            yield opened
    harness.close()


def answer(line: socket.socket) -> int:
    """Read one response to its end; returns its status, or 0 if the connection has ended."""
    with line.makefile("rb") as file:
        status = file.readline()
        if not status:
            return 0
        length = 0
        while (header := file.readline().lower()) not in (b"\r\n", b""):
            if header.startswith(b"content-length:"):
                length = int(header.partition(b":")[2])
        file.read(length)
        return int(status.split()[1])


@pytest.mark.parametrize(
    "body", [b"{}", b" " * 60_000, b"\n" * LINES], ids=["short", "long", "lines"]
)
@pytest.mark.parametrize("pieces", [1, 3])
def test_the_request_after_an_unread_body_is_answered(
    line: socket.socket, body: bytes, pieces: int
) -> None:
    line.sendall(HEAD + b"Content-Length: %d\r\n\r\n" % len(body))
    assert answer(line) == 404
    size = -(-len(body) // pieces)
    for place in range(0, len(body), size):
        line.sendall(body[place : place + size])
    line.sendall(NEXT)
    assert answer(line) == 200
    line.sendall(NEXT)
    assert answer(line) == 200


def test_a_body_that_would_be_too_long_ends_the_connection(line: socket.socket) -> None:
    host, port = line.getpeername()
    with socket.create_connection((host, port), timeout=30.0) as other:
        other.sendall(HEAD + b"Content-Length: 10000000\r\n\r\n")
        assert answer(other) in (404, 413)
        assert answer(other) == 0
