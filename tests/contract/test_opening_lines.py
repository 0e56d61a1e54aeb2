"""Opening a line: on failure everything already opened is closed, and the time is limited."""

import errno
import gc
import socket
import struct
from collections.abc import Generator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import Any

import pytest
import serial

from pincette.instruments.line import exclusive
from pincette.instruments.line.connecting import connected
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError, Link
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.wires.wire import serve

TIMEOUT_S = 0.4
DEAD, WITHIN_S = 10, 2.0
"""Number of addresses that do not reply, and the limit for all of them on a busy machine; with the
full timeout for each, it would take twice as long."""
NAME = "laser.example"
"""Host name that the name server of these tests knows."""

Address = tuple[socket.AddressFamily, str]


def opened(url: str) -> Link:
    return open_link(url, baud=115200, timeout_s=TIMEOUT_S)


def know(monkeypatch: pytest.MonkeyPatch, *addresses: Address) -> None:
    """Let ``NAME`` resolve to these addresses, in this order."""
    resolve = socket.getaddrinfo

    def found(host: str, port: int, *more: Any, **named: Any) -> list[Any]:
        if host != NAME:
            return list(resolve(host, port, *more, **named))
        kind, protocol = socket.SOCK_STREAM, socket.IPPROTO_TCP
        return [
            (family, kind, protocol, "", (one, port, 0, 0) if ":" in one else (one, port))
            for family, one in addresses
        ]

    monkeypatch.setattr(socket, "getaddrinfo", found)


@contextmanager
def unanswered(family: socket.AddressFamily, address: str, port: int) -> Generator[None]:
    """Make an address silent, like a host behind a failed network: its accept queue is full."""
    with ExitStack() as stack:
        listener = stack.enter_context(socket.socket(family, socket.SOCK_STREAM))
        listener.bind((address, port))
        listener.listen(0)
        for _ in range(3):
            line = stack.enter_context(socket.socket(family, socket.SOCK_STREAM))
            line.setblocking(False)
            assert line.connect_ex((address, port)) == errno.EINPROGRESS
        yield


@pytest.mark.parametrize("reset_before", ["getpeername", "setsockopt", "settimeout"])
def test_a_connection_that_is_reset_while_it_is_opened_is_closed_and_its_lock_freed(
    reset_before: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[socket.socket] = []

    class Reset(socket.socket):
        pass

    def failing(*_: object) -> None:
        raise OSError(errno.ENOTCONN, "the other end has reset the connection")

    setattr(Reset, reset_before, failing)

    def reset_later(host: str, port: int, timeout_s: float) -> socket.socket:
        with connected(host, port, timeout_s) as line:
            made.append(Reset(line.family, line.type, line.proto, line.detach()))
        return made[-1]

    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with monkeypatch.context() as patch:
            patch.setattr("pincette.instruments.link.connected", reset_later)
            with pytest.raises(InstrumentError, match="the other end has closed the connection"):
                opened(url)
        assert [line.fileno() for line in made] == [-1]
        opened(url).close()


def test_a_connection_that_is_reset_at_once_leaves_no_socket_open() -> None:
    """The warning of an unclosed socket fails a test, whichever call finds it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"

        def reset() -> None:
            peer, _ = server.accept()
            with peer:
                peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))

        for _ in range(3):
            thread = Thread(target=reset)
            thread.start()
            # a busy machine resets the connection after it was opened
            with suppress(InstrumentError):
                opened(url).close()
            thread.join()
    gc.collect()


def test_a_serial_port_that_cannot_be_prepared_is_closed_and_its_lock_file_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[serial.Serial] = []

    def fails(port: serial.Serial, _on: bool) -> None:
        made.append(port)
        raise RuntimeError("a driver that fails")

    monkeypatch.setattr(exclusive, "UUCP_LOCKS", tmp_path)
    monkeypatch.setattr(serial.Serial, "set_low_latency_mode", fails)
    with serve(str(tmp_path / "tty"), SimulatedKeyence(lambda: 0.0)) as wire:
        with pytest.raises(InstrumentError, match="RuntimeError: a driver that fails"):
            opened(wire.url)
        assert [port.is_open for port in made] == [False]
        assert not list(tmp_path.glob("LCK..*"))


@pytest.mark.parametrize(
    ("family", "dead"), [(socket.AF_INET6, "::1"), (socket.AF_INET, "127.0.0.2")]
)
def test_a_name_whose_first_address_is_dead_is_opened_within_the_timeout(
    family: socket.AddressFamily, dead: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with serve("socket://127.0.0.1:0", SimulatedKeyence(lambda: 0.0)) as wire:
        port = int(wire.url.rpartition(":")[2])
        know(monkeypatch, *[(family, dead)] * DEAD, (socket.AF_INET, "127.0.0.1"))
        with unanswered(family, dead, port):
            began_s = monotonic()
            with closing(opened(f"socket://{NAME}:{port}")) as line:
                assert line.exchange(b"R0") == b"ER,R0,01"
            assert monotonic() - began_s < WITHIN_S


def test_a_name_with_only_dead_addresses_is_given_up_in_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    know(monkeypatch, *[(socket.AF_INET, "127.0.0.2")] * DEAD)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        with unanswered(socket.AF_INET, "127.0.0.2", port):
            began_s = monotonic()
            with pytest.raises(InstrumentError, match="its host does not answer"):
                opened(f"socket://{NAME}:{port}")
            assert monotonic() - began_s < WITHIN_S
