"""Every way a port can fail must come out as an error that says what happened."""

import socket
import struct
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pincette.instruments.link import LONGEST_FRAME, open_link
from pincette.instruments.protocols import InstrumentError, Link
from pincette.sim.keyence import SimulatedKeyence
from pincette.sim.wire import serve

Script = Callable[[list[bytes | None]], str]


def _solicited(line: bytes) -> bool:
    return not line.startswith(b"TG,")


@contextmanager
def opened(url: str, timeout_s: float = 0.2) -> Generator[Link]:
    link = open_link(url, baud=115200, timeout_s=timeout_s, accept=_solicited)
    yield link
    link.close()


def test_an_answer_comes_without_its_terminator(script: Script) -> None:
    with opened(script([b"R0\r", b"MS,01,+0001.00\r"])) as link:
        assert link.exchange(b"R0") == b"R0"
        assert link.exchange(b"MS,01") == b"MS,01,+0001.00"


def test_unsolicited_lines_are_skipped(script: Script) -> None:
    with opened(script([b"TG,01,+0009.00\rTG,02,XXXXXXXX\rMS,01,+0001.00\r"])) as link:
        assert link.exchange(b"MS,01") == b"MS,01,+0001.00"


def test_what_follows_the_answer_is_not_taken_for_the_next(script: Script) -> None:
    with opened(script([b"A\rB\rC", b"D\r"])) as link:
        assert link.exchange(b"1") == b"A"
        assert link.exchange(b"2") == b"D"


def test_a_partial_answer_is_an_error_and_the_next_exchange_is_clean(script: Script) -> None:
    url = script([b"MS,01,+00", b"MS,01,+0002.00\r"])
    with opened(url) as link:
        with pytest.raises(InstrumentError, match=r"only b'MS,01,\+00' within 0\.2 s") as caught:
            link.exchange(b"MS,01")
        assert str(caught.value).startswith(url)
        assert link.exchange(b"MS,01") == b"MS,01,+0002.00"


def test_unsolicited_lines_alone_are_no_answer(script: Script) -> None:
    with (
        opened(script([b"TG,01,+0009.00\r"])) as link,
        pytest.raises(InstrumentError, match="no answer"),
    ):
        link.exchange(b"MS,01")


def test_a_frame_without_an_end_is_cut_off(script: Script) -> None:
    with (
        opened(script([b"x" * (LONGEST_FRAME + 1)])) as link,
        pytest.raises(InstrumentError, match=f"{LONGEST_FRAME + 1} bytes without an end"),
    ):
        link.exchange(b"MS,01")


def test_a_hang_up_is_named_and_stays(script: Script) -> None:
    url = script([None])
    with opened(url) as link:
        for _ in range(3):
            with pytest.raises(InstrumentError, match="hung up") as caught:
                link.exchange(b"MS,01")
            assert str(caught.value).startswith(url)


def test_a_reset_connection_is_a_hang_up_and_is_closed_cleanly() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"socket://127.0.0.1:{listener.getsockname()[1]}"
        with opened(url) as link:
            peer, _ = listener.accept()
            # Lingering for no time sends a reset instead of an orderly end.
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            peer.close()
            with pytest.raises(InstrumentError, match="hung up"):
                link.exchange(b"MS,01")


def test_a_vanished_pseudo_terminal_is_a_hang_up(tmp_path: Path) -> None:
    wire = serve(str(tmp_path / "port"), SimulatedKeyence(lambda: 0.0))
    with opened(wire.url) as link:
        assert link.exchange(b"R0") == b"ER,R0,01"
        wire.close()
        for _ in range(2):
            with pytest.raises(InstrumentError, match="hung up"):
                link.exchange(b"MS,01")
    with pytest.raises(InstrumentError, match="no such device"):
        open_link(wire.url, baud=115200, timeout_s=0.1)


def test_a_refused_connection_says_what_to_do() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"socket://127.0.0.1:{listener.getsockname()[1]}"
    with pytest.raises(InstrumentError, match="connection refused; is the instrument") as caught:
        open_link(url, baud=115200, timeout_s=0.1)
    assert str(caught.value).startswith(url)


@pytest.mark.parametrize("url", ["nonsense://x", "socket://127.0.0.1:99999", "socket://127.0.0.1"])
def test_a_url_that_is_none_is_an_error(url: str) -> None:
    with pytest.raises(InstrumentError, match="check the url"):
        open_link(url, baud=115200, timeout_s=0.1)


def test_a_port_without_a_descriptor_serves_too() -> None:
    with opened("loop://", timeout_s=0.05) as link:
        assert link.exchange(b"echo") == b"echo"
        with pytest.raises(InstrumentError, match="no answer"):
            link.exchange(b"TG,01")
        assert link.exchange(b"again") == b"again"
