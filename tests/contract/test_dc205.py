"""The DC205's driver: its bytes, and its handling of refusals and of arbitrary bytes on the
line."""

import logging
import random
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from functools import partial

import pytest

from pincette.config import ConfigError, Output
from pincette.instruments import srs_dc205
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.line.serial_link import RETRY_S
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError, WatchedOutput
from pincette.sim.instruments import dc205
from pincette.sim.instruments.dc205 import SimulatedDC205
from pincette.sim.wires.wire import serve

ANY = "socket://127.0.0.1:0"
SEED = 205
REPLIES = 3000
NAME = b"Stanford Research Systems,DC205,s/n20512345,ver1.00"
ALPHABET = b"0123456789+-.;,: EONFKAYVLDRG1\r\x00\xff"


def settings(url: str = "memory://", /, **options: str | float | bool) -> Output:
    return Output(driver="srs_dc205", url=url, timeout_s=0.2, options=dict(options))


class Recorded:
    """A source behind a link that records each line; its replies can be replaced."""

    def __init__(self, *before: bytes) -> None:
        self.voltages_V: list[float] = []
        self.source = SimulatedDC205(self.voltages_V.append)
        for line in before:
            self.source.answer(line)
        self.voltages_V.clear()
        self.lines: list[bytes] = []
        self.voice: Callable[[bytes], bytes | None] = self.source.answer
        self.link = MemoryLink(self._answer)

    def _answer(self, line: bytes) -> bytes | None:
        self.lines.append(line)
        return self.voice(line)

    def open(self, **options: str | float | bool) -> srs_dc205.DC205:
        return srs_dc205.open_output(settings(**options), self.link)


def test_the_bytes_match_the_manual_of_the_instrument() -> None:
    line = Recorded()
    output = line.open()
    output.write_V(1.5)
    output.write_V(-0.25)
    assert output.read_V() == -0.25
    assert line.lines == [
        b"TERM LF;*IDN?",
        b"LEXE?;LCME?;RNGE?;SOUT?;VOLT?",
        b"VOLT 0;RNGE RANGE10;LEXE?;LCME?",
        b"VOLT 1.500000;LEXE?;LCME?",
        b"SOUT 1;LEXE?;LCME?",
        b"VOLT -0.250000;SOUT?;LEXE?;LCME?",
        b"VOLT?;SOUT?;OVLD?",
    ]
    assert line.voltages_V == [1.5, -0.25]


def test_the_output_is_switched_on_only_after_its_voltage_is_accepted() -> None:
    line = Recorded()
    output = line.open()
    line.voice = lambda said: b"1;0" if said.startswith(b"VOLT") else line.source.answer(said)
    with pytest.raises(InstrumentError, match=r"\+2\.000000 V refused.*illegal value"):
        output.write_V(2.0)
    assert not any(said.startswith(b"SOUT 1") for said in line.lines)


def test_an_output_that_is_on_is_taken_over_unchanged() -> None:
    line = Recorded(b"RNGE RANGE10;VOLT 3.5;SOUT ON")
    output = line.open()
    assert output.read_V() == 3.5
    assert line.voltages_V == []
    output.write_V(3.25)
    assert line.voltages_V == [3.25]


def test_an_output_that_is_on_in_another_range_is_not_opened() -> None:
    line = Recorded(b"RNGE RANGE1;VOLT 0.5;SOUT ON")
    with pytest.raises(InstrumentError, match=r"on, \+0\.500000 V in the range of ±1 V; switch it"):
        line.open()
    with pytest.raises(InstrumentError, match="port is closed"):
        line.link.exchange(b"*IDN?")
    assert line.voltages_V == []


def test_errors_stored_before_opening_are_ignored() -> None:
    output = Recorded(b"VOLT 99;NONE?").open()
    output.write_V(0.5)
    assert output.read_V() == 0.5


def test_an_output_that_was_switched_off_by_hand_is_not_switched_on_again() -> None:
    line = Recorded()
    output = line.open()
    output.write_V(2.0)
    line.source.answer(b"SOUT 0")
    for _ in range(2):
        with pytest.raises(InstrumentError, match=r"\+1\.000000 V not put out: .*switched off"):
            output.write_V(1.0)
    assert output.read_V() == 0.0
    assert line.voltages_V == [2.0, 0.0]


def test_a_reading_during_an_overload_is_refused() -> None:
    line = Recorded()
    output = line.open()
    output.write_V(2.0)
    line.source.overloaded = True
    with pytest.raises(InstrumentError, match=r"overloaded, \+2\.000000 V is not held"):
        output.read_V()


@pytest.mark.parametrize(
    ("reply", "cause"),
    [
        (b"ON;1;0", r"execution error 1 \(illegal value\)"),
        (b"ON;0;9", r"command error 9 \(bad floating-point number\)"),
        (b"ON;77;0", r"execution error 77 \(no meaning known\)"),
        (b"ON;0", "2 answers"),
        (b"ON;x;0", "not an error code"),
        (b"2;0;0", "is none of"),
    ],
)
def test_a_refusal_names_value_and_cause(reply: bytes, cause: str) -> None:
    line = Recorded()
    output = line.open()
    output.write_V(0.0)
    line.voice = lambda _said: reply
    with pytest.raises(InstrumentError, match=cause) as refused:
        output.write_V(-1.5)
    assert "DC205" in str(refused.value)
    if b"0;0" not in reply and reply.count(b";") == 2:
        assert "-1.500000 V" in str(refused.value)


@pytest.mark.parametrize("name", [b"!017024", b"Stanford Research Systems,SIM928,s/n1,ver1"])
def test_a_different_instrument_is_refused_at_opening(name: bytes) -> None:
    line = Recorded()
    line.voice = lambda _said: name
    with pytest.raises(InstrumentError, match="names another instrument"):
        line.open()


@pytest.mark.parametrize(
    ("option", "value"), [("range_V", 5), ("range_V", "10"), ("baud", 19200), ("address", 1)]
)
def test_impossible_options_are_refused(option: str, value: str | int) -> None:
    with pytest.raises(ConfigError, match=f"srs_dc205 option {option} = {value!r}"):
        Recorded().open(**{option: value})


def test_opening_a_port_warns_that_the_driver_was_not_tested_with_its_instrument(
    caplog: pytest.LogCaptureFixture,
) -> None:
    source = SimulatedDC205(lambda _voltage_V: None)
    with (
        caplog.at_level(logging.WARNING),
        serve("socket://127.0.0.1:0", source, terminator=dc205.TERMINATOR) as wire,
    ):
        srs_dc205.open_output(settings(wire.url)).close()
    assert "srs_dc205 has not been tested with its instrument" in caplog.text
    assert not srs_dc205.MET


def test_after_a_port_is_reopened_the_output_is_on_and_works() -> None:
    line = Recorded()
    now_s = 0.0
    with lent_clock(lambda: now_s), ExitStack() as wires:
        wire = wires.enter_context(serve(ANY, line.source, terminator=dc205.TERMINATOR))
        output = srs_dc205.open_output(settings(wire.url))
        wires.callback(output.close)
        output.write_V(2.0)
        wire.close()
        with pytest.raises(InstrumentError) as caught:
            output.write_V(2.1)
        assert caught.value.code == "hung_up"
        line.source.answer(b"VOLT 99;NONE?")
        wires.enter_context(serve(wire.url, line.source, terminator=dc205.TERMINATOR))
        now_s = RETRY_S
        output.write_V(2.2)
        assert line.voltages_V == [2.0, 2.2]


def test_a_source_that_lost_its_power_is_not_switched_on_again() -> None:
    before, after = Recorded(), Recorded()
    now_s = 0.0
    with lent_clock(lambda: now_s), ExitStack() as wires:
        wire = wires.enter_context(serve(ANY, before.source, terminator=dc205.TERMINATOR))
        output = srs_dc205.open_output(settings(wire.url))
        wires.callback(output.close)
        output.write_V(2.0)
        wire.close()
        with pytest.raises(InstrumentError, match="connection was closed"):
            output.write_V(2.1)
        wires.enter_context(serve(wire.url, after.source, terminator=dc205.TERMINATOR))
        now_s = RETRY_S
        for _ in range(2):
            with pytest.raises(InstrumentError, match="has been switched off") as caught:
                output.write_V(2.2)
            assert caught.value.code == "refused"
        assert output.read_V() == 0.0
        assert after.voltages_V == []


@contextmanager
def lent_clock(clock: Callable[[], float]) -> Generator[None]:
    """Give the links that the driver opens another clock."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(srs_dc205, "open_link", partial(open_link, clock=clock))
        yield


@pytest.mark.parametrize(("baud", "exchange_ms"), [(9600, 42.7), (115200, 3.6)])
def test_the_duration_of_a_write_is_computed_from_the_line_settings(
    baud: int, exchange_ms: float
) -> None:
    timing = srs_dc205.timing(settings(baud=baud))
    # VOLT -10.000000;SOUT?;LEXE?;LCME? and ON;0;0, a line feed each.
    assert round(1e3 * timing.exchange_s, 1) == exchange_ms
    assert timing.response_s == 0.0
    assert "assumed" in timing.note


def test_the_source_has_no_watchdog() -> None:
    assert not isinstance(Recorded().open(), WatchedOutput)


def test_every_fault_of_the_line_raises_the_same_exception_type() -> None:
    chance = random.Random(SEED)
    failed = 0
    for _ in range(REPLIES):
        line = Recorded()
        output = line.open()
        if chance.randrange(2):
            output.write_V(0.0)
        honest = line.voice
        line.voice = partial(_spoilt, honest, chance)
        for act in (line.open, output.read_V, partial(output.write_V, 1.0)):
            try:
                act()
            except InstrumentError:
                failed += 1
    assert failed > REPLIES, f"seed {SEED}"


def _spoilt(
    honest: Callable[[bytes], bytes | None], chance: random.Random, line: bytes
) -> bytes | None:
    """Return the reply with a byte changed, dropped or added, or something else entirely, or
    None."""
    reply, kind = honest(line), chance.randrange(6)
    if kind == 0 or reply is None:
        return None
    if kind == 1:
        return bytes(chance.choices(ALPHABET, k=chance.randrange(40)))
    if kind == 2:
        return chance.randbytes(chance.randrange(40))
    place = chance.randrange(len(reply) + 1)
    byte = bytes(chance.choices(ALPHABET, k=1)) if kind < 5 else b""
    return reply[:place] + byte + reply[place + (kind != 3) :]
