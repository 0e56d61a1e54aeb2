"""Every failure of a port raises an error that states what happened."""

import io
import logging
import socket
import struct
import termios
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

import pytest
import serial

from pincette.instruments.keyence_lkg import answers
from pincette.instruments.line.serial_link import LEAST_PATIENCE_S, Line
from pincette.instruments.link import LONGEST_FRAME, open_link
from pincette.instruments.protocols import ErrorCode, InstrumentError, Link
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.wires.wire import serve

Script = Callable[[list[bytes | None]], str]


def _solicited(line: bytes) -> bool:
    return not line.startswith(b"TG,")


@contextmanager
def opened(url: str, timeout_s: float = 0.5, **more: Any) -> Generator[Link]:
    link = open_link(url, baud=115200, timeout_s=timeout_s, accept=_solicited, **more)
    try:
        yield link
    finally:
        link.close()


def test_an_answer_is_returned_without_its_terminator(script: Script) -> None:
    with opened(script([b"R0\r", b"MS,01,+0001.00\r"])) as link:
        assert link.exchange(b"R0") == b"R0"
        assert link.exchange(b"MS,01") == b"MS,01,+0001.00"


def test_unsolicited_lines_are_skipped(script: Script) -> None:
    with opened(script([b"TG,01,+0009.00\rTG,02,XXXXXXXX\rMS,01,+0001.00\r"])) as link:
        assert link.exchange(b"MS,01") == b"MS,01,+0001.00"


def test_data_after_the_answer_is_not_mistaken_for_the_next_answer(script: Script) -> None:
    with opened(script([b"A\rB\rC", b"D\r"])) as link:
        assert link.exchange(b"1") == b"A"
        assert link.exchange(b"2") == b"D"


def test_a_partial_answer_is_an_error_and_the_next_exchange_is_clean(script: Script) -> None:
    url = script([b"MS,01,+00", b"ER,R0,01\r", b"MS,01,+0002.00\r"])
    with opened(url, answers=answers, probes=(b"R0",)) as link:
        with pytest.raises(InstrumentError, match=r"only b'MS,01,\+00' within 0\.5 s") as caught:
            link.exchange(b"MS,01")
        assert str(caught.value).startswith(url)
        assert caught.value.code == "garbled"
        assert link.exchange(b"MS,01") == b"MS,01,+0002.00"


@pytest.mark.parametrize(
    ("timeout_s", "quiet_s"), [(0.1, 0.001), (0.0003, 30 / 115200), (0.001, 0.0005)]
)
def test_the_wait_for_a_quiet_line_leaves_time_for_an_exchange(
    script: Script, timeout_s: float, quiet_s: float
) -> None:
    with opened(script([]), timeout_s) as link:
        assert isinstance(link, Line)
        assert link.quiet_s == pytest.approx(quiet_s)


def test_unsolicited_lines_are_not_answers(script: Script) -> None:
    with (
        opened(script([b"TG,01,+0009.00\r"])) as link,
        pytest.raises(InstrumentError, match="no answer") as caught,
    ):
        link.exchange(b"MS,01")
    assert caught.value.code == "silent"


def test_a_frame_without_an_end_is_refused(script: Script) -> None:
    with (
        opened(script([b"x" * (LONGEST_FRAME + 1)])) as link,
        pytest.raises(InstrumentError, match=f"{LONGEST_FRAME + 1} bytes without an end") as caught,
    ):
        link.exchange(b"MS,01")
    assert caught.value.code == "garbled"


def test_a_closed_connection_is_named(script: Script) -> None:
    url = script([None])
    with opened(url) as link:
        with pytest.raises(InstrumentError, match="connection was closed") as caught:
            link.exchange(b"MS,01")
        assert str(caught.value).startswith(url)
        assert caught.value.code == "hung_up"


def test_a_link_that_was_closed_stays_closed(script: Script) -> None:
    with opened(script([])) as link:
        link.close()
        for _ in range(2):
            with pytest.raises(InstrumentError, match="port is closed") as caught:
                link.exchange(b"MS,01")
            assert caught.value.code == "misused"


def test_a_reset_connection_is_closed_cleanly() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"socket://127.0.0.1:{listener.getsockname()[1]}"
        with opened(url) as link:
            peer, _ = listener.accept()
            # A linger time of zero sends a reset instead of an orderly end.
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            peer.close()
            with pytest.raises(InstrumentError, match="connection was closed"):
                link.exchange(b"MS,01")


def test_a_vanished_pseudo_terminal_counts_as_a_closed_connection(tmp_path: Path) -> None:
    wire = serve(str(tmp_path / "port"), SimulatedKeyence(lambda: 0.0))
    with opened(wire.url) as link:
        assert link.exchange(b"R0") == b"ER,R0,01"
        wire.close()
        for _ in range(2):
            with pytest.raises(InstrumentError, match="connection was closed"):
                link.exchange(b"MS,01")
    with pytest.raises(InstrumentError, match="no such device") as caught:
        open_link(wire.url, baud=115200, timeout_s=0.1)
    assert caught.value.code == "cannot_open"


def test_a_refused_connection_states_a_remedy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"socket://127.0.0.1:{listener.getsockname()[1]}"
    with pytest.raises(InstrumentError, match="connection refused; is the instrument") as caught:
        open_link(url, baud=115200, timeout_s=0.1)
    assert str(caught.value).startswith(url)


@pytest.mark.parametrize("url", ["nonsense://x", "socket://127.0.0.1:99999", "socket://127.0.0.1"])
def test_a_url_that_is_invalid_is_an_error(url: str) -> None:
    with pytest.raises(InstrumentError, match="check the url"):
        open_link(url, baud=115200, timeout_s=0.1)


def test_a_port_without_a_descriptor_works_too() -> None:
    now_s = 0.0
    with opened("loop://", timeout_s=0.05, clock=lambda: now_s) as link:
        assert link.exchange(b"echo") == b"echo"
    with opened("loop://", timeout_s=0.05) as link:
        with pytest.raises(InstrumentError, match="no answer"):
            link.exchange(b"TG,01")
        with pytest.raises(InstrumentError, match="may still come"):
            link.exchange(b"again")


def test_a_command_that_has_no_answer_is_sent_before_the_next_request(script: Script) -> None:
    with opened(script([b"", b"!01+00.000\r"])) as link:
        link.tell(b"~**")
        assert link.exchange(b"$0180") == b"!01+00.000"


class Wreck:
    """A port of pyserial that raises the exception of the test case."""

    def __init__(self, error: Exception) -> None:
        self.error = error
        self.silent = True
        """True until the first write: reading then returns nothing instead of raising."""
        self.timeout: float | None = 0.0
        self.in_waiting = 0

    def fileno(self) -> int:
        raise io.UnsupportedOperation

    def read(self, _size: int = 1, /) -> bytes:
        if self.silent:
            return b""
        raise self.error

    def write(self, _data: bytes, /) -> int:
        self.silent = False
        raise self.error

    def close(self) -> None:
        raise self.error


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (serial.SerialException("gone"), "hung_up"),
        (OSError(5, "input/output error"), "hung_up"),
        (termios.error(5, "input/output error"), "hung_up"),
        (TypeError("an integer is required"), "hung_up"),
        (ValueError("file descriptor cannot be negative"), "hung_up"),
        (serial.SerialTimeoutException("write timeout"), "silent"),
    ],
)
def test_every_exception_of_a_port_is_converted_to_the_same_type(
    error: Exception, cause: ErrorCode, monkeypatch: pytest.MonkeyPatch
) -> None:
    def port(*_wanted: object, **_how: object) -> Wreck:
        return Wreck(error)

    monkeypatch.setattr(serial, "serial_for_url", port)
    with opened("/dev/wreck") as link:
        with pytest.raises(InstrumentError, match="/dev/wreck") as caught:
            link.exchange(b"MS,01")
        assert caught.value.code == cause


def test_every_exchange_is_logged_with_its_bytes_escaped(
    script: Script, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "pincette.instruments.link")
    with opened(script([b"\xff\x00\r", None])) as link:
        link.exchange(b"MS,01")
        with pytest.raises(InstrumentError):
            link.exchange(b"R0")
    first, second = [record.getMessage() for record in caplog.records]
    assert first.endswith(r": MS,01 -> \xff\x00")
    assert ": R0 -> hung_up: " in second


def test_after_a_peer_has_vanished_the_link_reconnects_to_its_successor() -> None:
    """As after a network failure: the connection remains open, but no program replies over it."""
    passed_s = 0.0
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with opened(url, timeout_s=0.02, clock=lambda: monotonic() + passed_s) as link:
            dead, _ = server.accept()
            for _ in range(8):
                with pytest.raises(InstrumentError) as caught:
                    link.exchange(b"R0")
                assert caught.value.code == "silent"
            dead.settimeout(2.0)
            assert dead.recv(16) == b"R0\r", (
                "the request must be sent once, since its answer may still arrive"
            )
            passed_s = LEAST_PATIENCE_S
            server.settimeout(2.0)
            with pytest.raises(InstrumentError):
                link.exchange(b"R0")
            back, _ = server.accept()
            with back, dead:
                assert back.recv(16) == b"R0\r"


def test_a_connection_ends_if_data_is_never_acknowledged(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[int, object] = {}
    whole = socket.socket.setsockopt

    def noted(self: socket.socket, level: int, option: int, value: int) -> None:
        if level == socket.IPPROTO_TCP:
            given[option] = value
        whole(self, level, option, value)

    monkeypatch.setattr(socket.socket, "setsockopt", noted)
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with opened(url, timeout_s=0.5):
            assert given[socket.TCP_USER_TIMEOUT] == 2000
