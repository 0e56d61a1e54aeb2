import random

import pytest

from pincette.config import ConfigError
from pincette.sim.bench import open_bench
from pincette.sim.instruments.dc205 import IDENTITY, LONGEST_LINE, TERMINATOR, SimulatedDC205
from pincette.sim.instruments.dcon import SimulatedI7024
from tests.support.rigs import demo_rig

SEED = 1000
LINES = 5000
PARTS = (
    b"VOLT", b"VOLT 1.5", b"VOLT?", b"SOUT 1", b"SOUT OFF", b"RNGE RANGE100", b"RNGE 0", b"*IDN?",
    b"TERM LF", b"TOKN 0", b"OVLD?", b"LEXE?", b"LCME?", b"VOLT -1e99", b"VOLT 1e999", b"SOUT ,",
)  # fmt: skip


class Stage:
    """A source, and its output voltages."""

    def __init__(self) -> None:
        self.voltages_V: list[float] = []
        self.source = SimulatedDC205(self.voltages_V.append)


def test_lines_end_with_a_line_feed() -> None:
    assert TERMINATOR == b"\n"


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"*IDN?", IDENTITY),
        (b"VOLT?", b"0.000000"),
        (b"RNGE?", b"RANGE1"),
        (b"SOUT?", b"OFF"),
        (b"OVLD?", b"OKAY"),
        (b"TERM?", b"LF"),
        (b"LEXE?; LCME?", b"0;0"),
        (b"TOKN OFF;RNGE?;SOUT?;OVLD?", b"0;0;0"),
        (b"VOLT 0.25;VOLT?", b"0.250000"),
        (b" VOLT  -2.5e-1 ;; VOLT?\r", b"-0.250000"),
        (b"VOLT 0.1234567;VOLT?", b"0.123457"),
        (b"VOLT 0.25", None),
        (b"SOUT 1", None),
        (b"", None),
        (b";", None),
        (b"*IDN?" + b" " * LONGEST_LINE, None),
    ],
)
def test_a_source_answers_in_its_initial_state(line: bytes, reply: bytes | None) -> None:
    assert Stage().source.answer(line) == reply


@pytest.mark.parametrize(
    ("line", "execution", "command"),
    [
        (b"VOLT 1.000001", 1, 0),
        (b"VOLT -1e9", 1, 0),
        (b"SOUT 1;RNGE RANGE10", 5, 0),
        (b"\xff", 0, 1),
        (b"VOLTAGE 1", 0, 1),
        (b"volt 1", 0, 1),
        (b"CURR 1", 0, 2),
        (b"*IDN", 0, 4),
        (b"OVLD 1", 0, 4),
        (b"VOLT", 0, 5),
        (b"VOLT 1,2", 0, 6),
        (b"VOLT? 1", 0, 6),
        (b"VOLT ,1", 0, 7),
        (b"VOLT nan", 0, 9),
        (b"VOLT 1_0", 0, 9),
        (b"SOUT 2", 0, 12),
        (b"RNGE RANGE5", 0, 14),
    ],
)
def test_the_simulated_source_stores_an_error_until_it_is_read(
    line: bytes, execution: int, command: int
) -> None:
    source = Stage().source
    assert source.answer(line) is None
    assert source.answer(b"LEXE?;LCME?") == b"%d;%d" % (execution, command)
    assert source.answer(b"LEXE?;LCME?") == b"0;0"


def test_voltages_reach_the_simulated_arm_only_while_the_output_is_on() -> None:
    stage = Stage()
    for line in (b"VOLT 0.5", b"SOUT 1", b"SOUT 1", b"VOLT 0.75", b"VOLT 0.75", b"VOLT 3"):
        stage.source.answer(line)
    assert stage.voltages_V == [0.5, 0.75, 0.75]
    stage.source.answer(b"SOUT OFF;VOLT 0.25")
    assert stage.voltages_V == [0.5, 0.75, 0.75, 0.0]
    assert stage.source.answer(b"VOLT?;SOUT?") == b"0.250000;OFF"


@pytest.mark.parametrize(("name", "limit_V"), [(b"RANGE1", 1), (b"RANGE10", 10), (b"2", 100)])
def test_a_range_bounds_the_voltage(name: bytes, limit_V: int) -> None:
    stage = Stage()
    stage.source.answer(b"RNGE " + name)
    for sign in (b"", b"-"):
        assert stage.source.answer(b"VOLT %s%d;LEXE?" % (sign, limit_V)) == b"0"
        assert stage.source.answer(b"VOLT %s%d.000001;LEXE?" % (sign, limit_V)) == b"1"
    assert stage.source.answer(b"VOLT?") == b"-%d.000000" % limit_V


def test_a_smaller_range_clamps_the_voltage() -> None:
    source = Stage().source
    assert source.answer(b"RNGE RANGE10;VOLT 5;RNGE RANGE1;VOLT?") == b"0.000000"


def test_an_overload_is_reported() -> None:
    source = SimulatedDC205(lambda _voltage_V: None, overloaded=True)
    assert source.answer(b"OVLD?") == b"OVLD"


def test_the_simulated_instrument_survives_arbitrary_lines() -> None:
    chance = random.Random(SEED)
    stage = Stage()
    answered = 0
    for _ in range(LINES):
        line = b";".join(chance.choices(PARTS, k=chance.randrange(1, 6)))
        place = chance.randrange(len(line) + 1)
        spoilt = line[:place] + chance.randbytes(chance.randrange(4)) + line[place:]
        reply = stage.source.answer(spoilt)
        answered += reply is not None
        assert reply is None or TERMINATOR not in reply, f"seed {SEED}: {spoilt!r}"
        assert all(abs(voltage_V) <= 100.0 for voltage_V in stage.voltages_V)
        stage.voltages_V.clear()
    assert LINES / 2 < answered < LINES
    assert stage.source.answer(b"*IDN?") == IDENTITY


def test_the_rig_file_chooses_the_instrument() -> None:
    def bench_of(driver: str) -> object:
        rig = demo_rig({"output": {"driver": driver}}, time="lockstep")
        return open_bench(rig, lambda: 0.0).output

    assert isinstance(bench_of("srs_dc205"), SimulatedDC205)
    assert isinstance(bench_of("icpdas_i7024"), SimulatedI7024)
    with pytest.raises(ConfigError, match=r"output.driver = 'other'.*, 'srs_"):
        bench_of("other")
