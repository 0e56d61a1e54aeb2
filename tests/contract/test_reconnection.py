"""A lost port is reopened at a limited rate, and the instrument is prepared before it continues."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from pincette.instruments.keyence_lkg import answers
from pincette.instruments.line.matching import Matching
from pincette.instruments.line.serial_link import GRACE, OFTEN, RETRY_S, Line
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError, Link
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.wires.wire import serve

TIMEOUT_S = 0.1
QUIET_S = 0.001


def echoed(request: bytes) -> re.Pattern[bytes]:
    return re.compile(b"re " + re.escape(request) + b".*")


class Rig:
    """An instrument at the end of a line that can be cut, in virtual time."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.there = True
        self.silent = False
        self.opened_at_s: list[float] = []
        self.said: list[bytes] = []
        self.arrived: list[bytes] = []
        self.prepare: Callable[[Link], None] = lambda _link: None
        self.matching = Matching(echoed, (b"PROBE",), lambda line: not line.startswith(b"TG"))
        self.line = Line(
            url="port",
            open_port=self._open,
            timeout_s=TIMEOUT_S,
            quiet_s=QUIET_S,
            terminator=b"\r",
            matching=lambda: self.matching,
            on_open=lambda link: self.prepare(link),
            clock=lambda: self.now_s,
        )

    def _open(self, within_s: float) -> "Rig":
        assert 0.0 < within_s <= TIMEOUT_S + 1e-9
        self.opened_at_s.append(self.now_s)
        if not self.there:
            raise InstrumentError("port: no such device", "cannot_open")
        self.arrived.clear()
        return self

    def write(self, data: bytes) -> None:
        if not self.there:
            raise OSError("input/output error")
        self.said.append(data)
        if not self.silent:
            self.arrived.append(b"re " + data)

    def receive(self, wait_s: float) -> bytes:
        if not self.there:
            raise OSError("input/output error")
        if self.arrived:
            return self.arrived.pop(0)
        self.now_s += wait_s
        return b""

    def close(self) -> None:
        pass


def failed(line: Link, request: bytes = b"A") -> InstrumentError:
    with pytest.raises(InstrumentError) as caught:
        line.exchange(request)
    return caught.value


def test_a_lost_exchange_fails_and_the_next_one_reopens_and_prepares_the_line() -> None:
    rig = Rig()
    rig.prepare = lambda link: rig.said.append(link.exchange(b"R0"))
    assert rig.line.exchange(b"A") == b"re A"
    rig.there = False
    assert failed(rig.line).code == "hung_up"
    rig.there = True
    assert rig.line.exchange(b"B") == b"re B"
    assert rig.said == [b"A\r", b"R0\r", b"re R0", b"B\r"]
    assert rig.line.exchange(b"C") == b"re C"
    assert len(rig.opened_at_s) == 2


def test_the_line_is_retried_every_half_second() -> None:
    rig = Rig()
    rig.there = False
    begin_s = rig.now_s
    for _ in range(201):
        assert failed(rig.line).code == "hung_up"
        rig.now_s += 0.01
    tries_s = [opened_s - begin_s for opened_s in rig.opened_at_s[1:]]
    assert tries_s == pytest.approx([0.01, 0.51, 1.01, 1.51], abs=0.011)
    assert failed(rig.line).code == "hung_up"


def test_a_line_that_breaks_at_once_is_not_reopened_more_often() -> None:
    rig = Rig()
    rig.there = False
    failed(rig.line)
    rig.there = True
    assert rig.line.exchange(b"A") == b"re A"
    for _ in range(10):
        rig.there = False
        failed(rig.line)
        rig.there = True
        rig.now_s += 0.01
        assert failed(rig.line).code == "hung_up"
    assert len(rig.opened_at_s) == 2


def test_a_port_that_is_lost_again_and_again_may_have_a_second_client() -> None:
    rig = Rig()
    texts = list[str]()
    for _ in range(OFTEN + 1):
        rig.there = False
        texts.append(str(failed(rig.line)))
        rig.there = True
        rig.now_s += RETRY_S
        assert rig.line.exchange(b"A") == b"re A"
    assert ["another program" in text for text in texts] == [False] * OFTEN + [True]


def test_a_fault_that_prevents_the_instrument_from_continuing_is_reported_with_its_cause() -> None:
    rig = Rig()

    def refuse(_link: Link) -> None:
        raise InstrumentError("in set-up mode", "refused")

    rig.there, rig.prepare = False, refuse
    failed(rig.line)
    rig.there = True
    error = failed(rig.line)
    assert error.code == "refused"
    assert "reopened, but the instrument cannot continue: in set-up mode" in str(error)
    assert rig.said == []
    rig.prepare = lambda _link: None
    assert failed(rig.line).code == "hung_up"
    rig.now_s += RETRY_S
    assert rig.line.exchange(b"A") == b"re A"


def test_reopening_takes_no_longer_than_an_exchange() -> None:
    rig = Rig()
    rig.prepare = lambda link: rig.said.append(link.exchange(b"R0"))
    rig.there = False
    failed(rig.line)
    rig.there, rig.silent = True, True
    began_s = rig.now_s
    error = failed(rig.line)
    assert error.code == "silent"
    assert rig.now_s - began_s <= TIMEOUT_S + 1e-9
    assert rig.said == [b"R0\r"]


def test_a_command_without_an_answer_reopens_the_port_too() -> None:
    rig = Rig()
    rig.there = False
    with pytest.raises(InstrumentError, match="connection was closed"):
        rig.line.tell(b"~**")
    rig.there = True
    rig.line.tell(b"~**")
    assert rig.said == [b"~**\r"]


def test_a_closed_line_is_not_opened_again() -> None:
    rig = Rig()
    rig.line.close()
    for _ in range(2):
        assert failed(rig.line).code == "misused"
        rig.now_s += 1.0
    assert len(rig.opened_at_s) == 1


def test_an_answer_delayed_by_a_stall_is_accepted() -> None:
    rig = Rig()
    rig.silent = True
    receive = rig.receive

    def stand_still(wait_s: float) -> bytes:
        if rig.said and rig.now_s < 1.0:
            rig.now_s = 3.0
            return b""
        if rig.now_s == 3.0:
            assert wait_s == pytest.approx(GRACE * TIMEOUT_S)
            rig.arrived.append(b"re A late\r")
        return receive(wait_s)

    rig.receive = stand_still
    assert rig.line.exchange(b"A") == b"re A late"


def test_after_unexpected_bytes_the_driver_waits_until_the_line_is_quiet() -> None:
    rig = Rig()
    write = rig.write

    def cut_off(data: bytes) -> None:
        rig.arrived.append(data.removesuffix(b"\r"))

    rig.write = cut_off
    assert failed(rig.line).code == "garbled"
    rig.write = write
    rig.arrived = [b" and the rest\r"]
    began_s = rig.now_s
    assert rig.line.exchange(b"B") == b"re B"
    assert rig.now_s == pytest.approx(began_s + QUIET_S)


def test_a_late_answer_fails_only_its_own_exchange() -> None:
    rig = Rig()
    rig.silent = True
    assert failed(rig.line).code == "silent"
    rig.silent = False
    rig.arrived = [b"TG,01,+0001.00\rre", b" A\r"]
    began_s = rig.now_s
    assert rig.line.exchange(b"B") == b"re B"
    assert rig.now_s == began_s  # the pending reply has arrived, so nothing is waited for


def test_the_line_is_not_clean_after_one_of_two_pending_answers() -> None:
    rig = Rig()
    rig.silent = True
    for request in (b"A", b"B"):
        assert failed(rig.line, request).code == "silent"
    rig.silent = False
    rig.arrived = [b"re A\r"]
    began_s = rig.now_s
    assert rig.line.exchange(b"C") == b"re C"
    assert rig.now_s > began_s


def test_a_line_that_is_never_quiet_is_an_error() -> None:
    rig = Rig()

    def chatter(wait_s: float) -> bytes:
        rig.now_s += min(wait_s, 0.001) or 0.0001
        return b"TG,01,+0001.00\r"

    rig.receive = chatter
    error = failed(rig.line)
    assert error.code == "garbled"
    assert "data without a pause" in str(error)
    assert rig.said == []


@pytest.mark.parametrize("kind", ["tcp", "pty"])
def test_an_instrument_that_returns_is_read_again(kind: str, tmp_path: Path) -> None:
    now_s = 0.0
    prepared = list[bytes]()
    url = "socket://127.0.0.1:0" if kind == "tcp" else str(tmp_path / "port")
    wire = serve(url, SimulatedKeyence(lambda: 1.0))
    url = wire.url
    link = open_link(
        url,
        baud=115200,
        timeout_s=5.0,
        answers=answers,
        on_open=lambda line: prepared.append(line.exchange(b"R0")),
        clock=lambda: now_s,
    )
    try:
        assert link.exchange(b"MS,01") == b"MS,01,+0001.00"
        wire.close()
        for _ in range(2):
            with pytest.raises(InstrumentError, match="connection was closed"):
                link.exchange(b"MS,01")
        wire = serve(url, SimulatedKeyence(lambda: 2.0))
        with pytest.raises(InstrumentError, match=r"next attempt in 0\.5 s"):
            link.exchange(b"MS,01")
        now_s = RETRY_S
        assert link.exchange(b"MS,01") == b"MS,01,+0002.00"
        assert prepared == [b"ER,R0,01"]
    finally:
        link.close()
        wire.close()
