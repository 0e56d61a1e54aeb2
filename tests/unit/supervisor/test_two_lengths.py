"""A request with two lengths is refused by the server itself, and its connection is closed."""

import socket
import threading
from collections.abc import Generator

import pytest
from fastapi import FastAPI

from pincette_supervisor.program import bind
from pincette_supervisor.rest.server import server_of

BODY = b"4\r\nwxyz\r\n0\r\n\r\n"
SMUGGLED = b"GET /seen HTTP/1.1\r\nHost: localhost\r\n\r\n"


@pytest.fixture
def heard() -> list[str]:
    return []


@pytest.fixture
def port(heard: list[str]) -> Generator[int]:
    app = FastAPI()

    @app.post("/any")
    async def post() -> str:  # pyright: ignore[reportUnusedFunction]
        heard.append("post")
        return "ok"

    @app.get("/seen")
    async def seen() -> str:  # pyright: ignore[reportUnusedFunction]
        heard.append("seen")
        return "ok"

    listener = bind("127.0.0.1", 0)
    server = server_of(app)
    thread = threading.Thread(target=server.run, args=([listener],))
    thread.start()
    while thread.is_alive() and not server.started:
        thread.join(0.02)
    yield listener.getsockname()[1]
    server.should_exit = True
    thread.join(5.0)
    listener.close()


def answer(port: int, data: bytes) -> bytes:
    """Return all that arrives until the server closes the connection, or is silent."""
    stated = b""
    with socket.create_connection(("127.0.0.1", port), 5.0) as client:
        client.settimeout(2.0)
        client.sendall(data)
        try:
            while more := client.recv(4096):
                stated += more
        except TimeoutError:
            stated += b"(still open)"
    return stated


def head(*lines: bytes) -> bytes:
    return b"\r\n".join((b"POST /any HTTP/1.1", b"Host: localhost", *lines, b"", b""))


@pytest.mark.parametrize("length", [b"0", b"4", b"14", b"999"])
def test_a_request_with_two_body_lengths_is_refused_and_not_read_further(
    port: int, heard: list[str], length: bytes
) -> None:
    both = head(b"Content-Length: " + length, b"Transfer-Encoding: chunked")
    output = answer(port, both + BODY + SMUGGLED)
    assert output.startswith(b"HTTP/1.1 400 ")
    assert b"still open" not in output
    assert output.count(b"HTTP/1.1") == 1
    assert heard == []


def test_a_single_length_is_accepted(port: int, heard: list[str]) -> None:
    assert answer(port, head(b"Content-Length: 4") + b"wxyz").startswith(b"HTTP/1.1 200 ")
    assert answer(port, head(b"Transfer-Encoding: chunked") + BODY).startswith(b"HTTP/1.1 200 ")
    assert heard == ["post", "post"]
