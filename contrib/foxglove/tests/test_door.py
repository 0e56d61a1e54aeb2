"""Checks of the origin of web pages that connect to the viewer server, with a client that sends
raw bytes."""

import socket
import ssl
import threading
from collections.abc import Generator
from contextlib import closing, suppress
from pathlib import Path

import pytest

from pincette.config.programs import VIEWERS, Foxglove
from pincette_foxglove.door import HEAD_BYTES, Door
from pincette_foxglove.program import certificate
from tests.support.certificates import folder_for
from tests.support.rigs import free_ports

ASKED = "GET / HTTP/1.1\r\nHost: 127.0.0.1:8765\r\nUpgrade: websocket\r\n"
WAIT_S = 10.0


@pytest.fixture
def behind() -> Generator[tuple[str, int]]:
    """A server that echoes received data, and ends when its client closes the connection."""
    listener = socket.create_server(("127.0.0.1", 0))

    def answer(line: socket.socket) -> None:
        with closing(line):
            while got := line.recv(65536):
                line.sendall(got)

    def serve() -> None:
        while True:
            try:
                line, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=answer, args=(line,), daemon=True).start()

    threading.Thread(target=serve, daemon=True).start()
    yield listener.getsockname()
    listener.shutdown(socket.SHUT_RDWR)
    listener.close()


@pytest.fixture
def place(behind: tuple[str, int]) -> Generator[tuple[str, int]]:
    where = "127.0.0.1", free_ports(1)
    door = Door(where, behind, (*VIEWERS, "https://viewer.example:8443"))
    yield where
    door.close()


def said(place: tuple[str, int], *lines: str) -> str:
    """The first answer to a request."""
    with socket.create_connection(place, WAIT_S) as line:
        line.sendall((ASKED + "".join(f"{one}\r\n" for one in lines) + "\r\n").encode())
        return line.recv(65536).decode()


@pytest.mark.parametrize(
    "lines",
    [
        (),
        ("Origin: https://app.foxglove.dev",),
        ("Origin: file://",),
        ("origin:https://viewer.example:8443",),
        ("Origin: http://localhost:8080",),
        ("Origin: http://127.0.0.1:8000",),
        ("Origin: http://[::1]",),
    ],
    ids=str,
)
def test_programs_and_known_pages_are_admitted(place: tuple[str, int], lines: list[str]) -> None:
    assert said(place, *lines).startswith("GET / HTTP/1.1\r\n")


@pytest.mark.parametrize(
    "origin",
    [
        "https://evil.example",
        "http://app.foxglove.dev",
        "https://app.foxglove.dev.evil.example",
        "https://viewer.example",
        "http://localhost.evil.example",
        "http://127.0.0.1@evil.example",
        "https://app.foxglove.dev https://evil.example",
        "http://[",
        "null",
        "",
    ],
)
def test_a_foreign_page_is_refused(place: tuple[str, int], origin: str) -> None:
    answer = said(place, f"Origin: {origin}")
    assert answer.startswith("HTTP/1.1 403 ")
    assert "[foxglove] origins" in answer
    both = said(place, "Origin: https://app.foxglove.dev", f"ORIGIN : {origin}")
    assert both.startswith("HTTP/1.1 403 ")


def test_data_after_the_handshake_is_forwarded_in_both_directions(place: tuple[str, int]) -> None:
    with socket.create_connection(place, WAIT_S) as line:
        line.sendall((ASKED + "\r\n").encode())
        assert line.recv(65536)
        much = bytes(1_000_000)
        sender = threading.Thread(target=line.sendall, args=(much,))
        sender.start()
        got = 0
        while got < len(much):
            got += len(line.recv(65536))
        sender.join()
        line.shutdown(socket.SHUT_WR)
        assert line.recv(1) == b""


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\n", bytes(2 * HEAD_BYTES)])
def test_a_connection_without_a_request_is_refused(place: tuple[str, int], sent: bytes) -> None:
    with socket.create_connection(place, WAIT_S) as line:
        line.sendall(sent)
        line.shutdown(socket.SHUT_WR)
        with suppress(ConnectionResetError):  # the server has not read all bytes
            assert line.recv(1) == b""
    assert said(place).startswith("GET")


def test_origins_are_checked_over_tls_too(behind: tuple[str, int], tmp_path: Path) -> None:
    pki = folder_for(tmp_path / "pki", "demo").path
    where = "127.0.0.1", free_ports(1)
    door = Door(where, behind, VIEWERS, certificate(str(pki / "router.crt")))
    trusting = ssl.create_default_context(cafile=str(pki / "authority.crt"))
    try:
        for origin, wanted in (("file://", b"GET"), ("https://evil.example", b"HTTP/1.1 403")):
            with (
                socket.create_connection(where, WAIT_S) as bare,
                trusting.wrap_socket(bare, server_hostname="127.0.0.1") as line,
            ):
                line.sendall(f"{ASKED}Origin: {origin}\r\n\r\n".encode())
                assert line.recv(65536).startswith(wanted)
    finally:
        door.close()


def test_a_port_in_use_is_an_error(place: tuple[str, int], behind: tuple[str, int]) -> None:
    with pytest.raises(OSError, match="in use"):
        Door(place, behind, VIEWERS)


@pytest.mark.parametrize("origin", ["null", "*", "viewer.example", "https://viewer.example/path"])
def test_an_invalid_origin_is_refused_in_the_rig_file(origin: str) -> None:
    with pytest.raises(ValueError, match="origins"):
        Foxglove(origins=(origin,))
