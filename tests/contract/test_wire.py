"""Simulated instruments on real ports: reconnection, line speed, clean refusals."""

import socket
import threading
import time
from itertools import chain, repeat
from pathlib import Path

import pytest

from pincette.instruments.keyence_lkg import answers
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.wires.ports import WireError
from pincette.sim.wires.wire import serve

ANY = "socket://127.0.0.1:0"


@pytest.mark.parametrize("kind", ["tcp", "pty"])
def test_a_reconnecting_client_is_served(kind: str, tmp_path: Path) -> None:
    url = ANY if kind == "tcp" else str(tmp_path / "port")
    with serve(url, SimulatedKeyence(lambda: 1.0)) as wire:
        for _ in range(3):
            link = open_link(wire.url, baud=115200, timeout_s=0.5)
            assert link.exchange(b"MS,01") == b"MS,01,+0001.00"
            link.close()


def test_bytes_on_a_simulated_line_take_their_transmission_time() -> None:
    with serve(ANY, SimulatedKeyence(lambda: 1.0), baud=9600) as wire:
        link = open_link(wire.url, baud=9600, timeout_s=1.0)
        began_s = time.monotonic()
        reply = link.exchange(b"MS,01")
        took_s = time.monotonic() - began_s
        link.close()
    assert reply == b"MS,01,+0001.00"
    assert took_s >= (6 + 15) * 10 / 9600


def test_an_answer_arrives_in_pieces() -> None:
    with serve(ANY, SimulatedKeyence(lambda: 1.0), baud=1200) as wire:
        host, _, port = wire.url.removeprefix("socket://").rpartition(":")
        with socket.create_connection((host, int(port)), timeout=5.0) as line:
            line.sendall(b"MS,01\r")
            pieces = list[bytes]()
            while not b"".join(pieces).endswith(b"\r"):
                pieces.append(line.recv(100))
    assert b"".join(pieces) == b"MS,01,+0001.00\r"
    assert len(pieces) > 3


def test_a_frame_may_arrive_in_pieces() -> None:
    cuts = chain([7, 0], repeat(100))
    with serve(ANY, SimulatedKeyence(lambda: 1.0), garble=lambda data: data[: next(cuts)]) as wire:
        probes = (b"R0", b"MM,100000000000")
        link = open_link(wire.url, baud=115200, timeout_s=0.1, answers=answers, probes=probes)
        for cause in ("garbled", "silent"):
            with pytest.raises(InstrumentError) as caught:
                link.exchange(b"MS,01")
            assert caught.value.code == cause
        assert link.exchange(b"MS,01") == b"MS,01,+0001.00"
        link.close()


def test_a_watchdog_trips_while_the_line_is_idle() -> None:
    out = list[float]()
    tripped = threading.Event()

    def put_out(voltage_V: float) -> None:
        out.append(voltage_V)
        if len(out) == 2:
            tripped.set()

    with serve(ANY, SimulatedI7024(put_out, time.monotonic)) as wire:
        link = open_link(wire.url, baud=115200, timeout_s=0.5)
        assert link.exchange(b"#010+01.000") == b">"
        assert link.exchange(b"~013101") == b"!01"
        assert tripped.wait(timeout=2.0)
        assert link.exchange(b"#010+01.000") == b"!"
        link.close()
    assert out == [1.0, 0.0]


def test_a_busy_port_is_named() -> None:
    instrument = SimulatedKeyence(lambda: 1.0)
    with serve(ANY, instrument) as wire:
        port = wire.url.rpartition(":")[2]
        with pytest.raises(WireError, match=rf":{port} is in use; stop the other program"):
            serve(wire.url, instrument)


def test_a_stale_symbolic_link_is_replaced_but_a_file_is_not(tmp_path: Path) -> None:
    path = tmp_path / "port"
    path.symlink_to(tmp_path / "gone")
    with serve(str(path), SimulatedKeyence(lambda: 1.0)):
        assert path.resolve().is_char_device()
    assert not path.is_symlink()
    path.write_text("kept")
    with pytest.raises(WireError, match="cannot create a pseudo-terminal there"):
        serve(str(path), SimulatedKeyence(lambda: 1.0))
    assert path.read_text() == "kept"


@pytest.mark.parametrize("url", ["socket://127.0.0.1", "socket://127.0.0.1:x", "ftp://a:1"])
def test_a_url_that_is_invalid_is_refused(url: str) -> None:
    with pytest.raises(WireError, match=url):
        serve(url, SimulatedKeyence(lambda: 1.0))
