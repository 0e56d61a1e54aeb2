"""An output whose line is lost and opened again at once: written again, or reported as a fault."""

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from pincette.core.faults import Fault, FaultCode
from pincette.core.service import SetVoltage
from pincette.engine.instrument import REOPEN_PERIODS, Instrument, ReadingWatch
from pincette.instruments.protocols import ErrorCode, InstrumentError

PERIOD_S = 0.02
SOON_S, TOO_LATE_S = 0.5 * REOPEN_PERIODS * PERIOD_S, 1.1 * REOPEN_PERIODS * PERIOD_S


@dataclass
class Output:
    """An output that keeps its voltage while its line is lost."""

    now_s: float = 0.0
    put_V: float = 0.0
    failing: list[ErrorCode] = field(default_factory=list[ErrorCode])
    """How the next writes and heartbeats fail."""
    heard: bool = False
    """True if a write that fails is carried out."""
    reopens_in_s: float | None = SOON_S
    """Time until the line is back; None: it does not come back."""
    loses: Callable[[], None] = lambda: None
    """What happens to the output while the line is away."""
    written_V: list[float] = field(default_factory=list[float])
    beats: int = 0

    def _fail(self) -> None:
        if self.failing:
            self.loses()
            raise InstrumentError("the other end has closed the connection", self.failing.pop(0))

    def write_V(self, voltage_V: float) -> None:
        if not self.failing or self.heard:
            self.put_V = voltage_V
        self._fail()
        self.written_V.append(voltage_V)

    def read_V(self) -> float:
        if self.reopens_in_s is None:
            raise InstrumentError("connection refused", "hung_up")
        self.now_s += self.reopens_in_s
        return self.put_V

    def keep_alive(self) -> None:
        self._fail()
        self.beats += 1

    def clear_trip(self) -> None: ...

    def close(self) -> None: ...


@dataclass
class Bench:
    output: Output
    instrument: Instrument

    def put_out(self, voltage_V: float) -> Fault | None:
        stated = self.instrument.put_out(SetVoltage((voltage_V,)))
        assert stated is None or isinstance(stated, Fault)
        return stated


@pytest.fixture
def bench() -> Bench:
    output = Output()
    watch = ReadingWatch(PERIOD_S, lambda: output.now_s)
    made = Bench(output, Instrument(output, PERIOD_S, watch))
    assert made.put_out(1.0) is None
    return made


@pytest.mark.parametrize("heard", [False, True])
def test_a_write_is_repeated_over_the_new_connection(bench: Bench, heard: bool) -> None:
    bench.output.failing, bench.output.heard = ["hung_up"], heard
    assert bench.put_out(1.2) is None
    assert bench.output.put_V == 1.2
    assert bench.instrument.counts.retried == 1
    assert bench.put_out(1.3) is None
    assert bench.output.written_V == [1.0, 1.2, 1.3]


def test_a_heartbeat_is_repeated_too(bench: Bench) -> None:
    bench.output.failing = ["hung_up"]
    assert bench.instrument.keep_alive(1.0) is None
    assert bench.output.beats == 1


def test_an_output_that_has_lost_its_voltage_is_not_written(bench: Bench) -> None:
    def lose() -> None:
        bench.output.put_V = 0.0

    bench.output.failing, bench.output.loses = ["hung_up"], lose
    found = bench.put_out(1.2)
    assert found is not None
    assert found.code is FaultCode.INSTRUMENT_HUNG_UP
    assert bench.output.written_V == [1.0]
    assert bench.output.put_V == 0.0


@pytest.mark.parametrize("reopens_in_s", [None, TOO_LATE_S])
def test_a_line_that_does_not_return_in_time_is_a_fault(
    bench: Bench, reopens_in_s: float | None
) -> None:
    bench.output.failing, bench.output.reopens_in_s = ["hung_up"], reopens_in_s
    found = bench.put_out(1.2)
    assert found is not None
    assert found.code is FaultCode.INSTRUMENT_HUNG_UP
    assert bench.output.written_V == [1.0]


def test_a_line_that_is_lost_again_is_a_fault(bench: Bench) -> None:
    bench.output.failing = ["hung_up", "hung_up"]
    assert bench.put_out(1.2) is not None
    assert bench.put_out(1.2) is None


@pytest.mark.parametrize("code", ["silent", "late", "garbled", "refused", "tripped"])
def test_any_other_failure_is_a_fault_at_once(bench: Bench, code: ErrorCode) -> None:
    bench.output.failing = [code]
    assert bench.put_out(1.2) is not None
    assert bench.output.written_V == [1.0]


def test_nothing_is_repeated_after_a_fault_until_the_output_has_confirmed_a_voltage(
    bench: Bench,
) -> None:
    bench.output.failing = ["silent", "hung_up"]
    assert bench.put_out(1.2) is not None
    assert bench.put_out(1.2) is not None
    assert bench.put_out(1.2) is None


def test_nothing_is_repeated_in_lockstep() -> None:
    output = Output()
    instrument = Instrument(output, PERIOD_S, None)
    assert instrument.put_out(SetVoltage((1.0,))) is None
    output.failing = ["hung_up"]
    assert instrument.put_out(SetVoltage((1.2,))) is not None
