"""Contract of every driver of a voltage output, over every kind of link."""

import math
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Protocol

import pytest

from pincette.config import Output
from pincette.instruments import icpdas_i7024, srs_dc205
from pincette.instruments.protocols import InstrumentError, Link, VoltageOutput
from pincette.sim.instruments import dc205
from pincette.sim.instruments.dc205 import SimulatedDC205
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.protocol import TERMINATOR, Instrument

TIMEOUT_S = 0.1
GARBAGE = (b"", b"\xff\x00;", b">>", b"> ", b"MS,01,+0001.50")


class Reach(Protocol):
    def __call__(
        self, instrument: Instrument, terminator: bytes = TERMINATOR, /
    ) -> tuple[str, Link | None]: ...


def _always(reply: bytes) -> Callable[[bytes], bytes]:
    return lambda _line: reply


class Load:
    """The load of an output; the instrument can be replaced by the test."""

    def __init__(self, instrument: Callable[[Callable[[float], None]], Instrument]) -> None:
        self.voltages_V: list[float] = []
        self.voice: Callable[[bytes], bytes | None] | None = None
        self._instrument = instrument(self.voltages_V.append)

    def answer(self, line: bytes) -> bytes | None:
        return self._instrument.answer(line) if self.voice is None else self.voice(line)

    def idle(self) -> None:
        self._instrument.idle()


class VoltageOutputContract:
    """Base class of the tests; a subclass states how the driver is opened and which instrument it
    drives."""

    step_V: float
    limit_V: float
    terminator: bytes = TERMINATOR

    def instrument(self, put_out: Callable[[float], None]) -> Instrument:
        raise NotImplementedError

    def open(self, url: str, link: Link | None) -> VoltageOutput:
        raise NotImplementedError

    @contextmanager
    def opened(self, reach: Reach) -> Generator[tuple[Load, VoltageOutput]]:
        load = Load(self.instrument)
        output = self.open(*reach(load, self.terminator))
        yield load, output
        output.close()

    def test_an_output_applies_the_commanded_voltage(self, reach: Reach) -> None:
        asked_V = [0.0, 1.2345, -0.0004, -self.limit_V, self.limit_V, 2.0]
        with self.opened(reach) as (load, output):
            for voltage_V in asked_V:
                output.write_V(voltage_V)
            assert load.voltages_V == pytest.approx(asked_V, abs=0.501 * self.step_V)

    def test_an_output_reads_back_its_voltage_without_moving(self, reach: Reach) -> None:
        with self.opened(reach) as (load, output):
            assert output.read_V() == 0.0
            output.write_V(-1.25)
            assert output.read_V() == pytest.approx(-1.25, abs=self.step_V)
            assert len(load.voltages_V) == 1

    def test_opening_moves_nothing(self, reach: Reach) -> None:
        with self.opened(reach) as (load, _):
            assert load.voltages_V == []

    def test_an_impossible_voltage_is_refused_before_it_is_sent(self, reach: Reach) -> None:
        with self.opened(reach) as (load, output):
            for voltage_V in (self.limit_V + 1e-3, -self.limit_V - 1e-3, math.nan, math.inf):
                with pytest.raises(
                    InstrumentError, match=rf"{voltage_V} V refused, limit"
                ) as caught:
                    output.write_V(voltage_V)
                assert caught.value.code == "misused"
            assert load.voltages_V == []

    def test_a_silent_sensor_is_an_error_until_it_answers(self, reach: Reach) -> None:
        with self.opened(reach) as (load, output):
            load.voice = lambda _line: None
            with pytest.raises(InstrumentError, match="no answer") as caught:
                output.write_V(1.0)
            assert caught.value.code == "silent"
            load.voice = None
            output.write_V(2.0)
            assert load.voltages_V == [2.0]

    def test_garbage_is_an_error(self, reach: Reach) -> None:
        with self.opened(reach) as (load, output):
            for garbage in GARBAGE:
                load.voice = _always(garbage)
                with pytest.raises(InstrumentError) as caught:
                    output.write_V(1.0)
                assert caught.value.code == "garbled"

    def test_a_closed_output_is_reported_and_may_be_closed_again(self, reach: Reach) -> None:
        with self.opened(reach) as (_, output):
            output.close()
            with pytest.raises(InstrumentError, match="port is closed") as caught:
                output.write_V(1.0)
            assert caught.value.code == "misused"

    def test_a_silent_instrument_is_not_opened(self, reach: Reach) -> None:
        load = Load(self.instrument)
        load.voice = lambda _line: None
        with pytest.raises(InstrumentError, match="no answer"):
            self.open(*reach(load, self.terminator))


def settings(url: str = "memory://", /, **options: str | float | bool) -> Output:
    return Output(driver="icpdas_i7024", url=url, timeout_s=TIMEOUT_S, options=dict(options))


class TestI7024(VoltageOutputContract):
    step_V, limit_V = 0.001, 10.0

    def instrument(self, put_out: Callable[[float], None]) -> Instrument:
        return SimulatedI7024(put_out, lambda: 0.0)

    def open(self, url: str, link: Link | None) -> VoltageOutput:
        return icpdas_i7024.open_output(settings(url), link)


@pytest.mark.parametrize("reach", ["memory"], indirect=True)
class TestI7024WithChecksum(VoltageOutputContract):
    step_V, limit_V = 0.001, 10.0

    def instrument(self, put_out: Callable[[float], None]) -> Instrument:
        return SimulatedI7024(put_out, lambda: 0.0, address=0xAB, channel=3, checksum=True)

    def open(self, url: str, link: Link | None) -> VoltageOutput:
        chosen = settings(url, address=0xAB, channel=3, checksum=True)
        return icpdas_i7024.open_output(chosen, link)


class TestDC205(VoltageOutputContract):
    step_V, limit_V, terminator = 1e-6, 10.0, dc205.TERMINATOR

    def instrument(self, put_out: Callable[[float], None]) -> Instrument:
        return SimulatedDC205(put_out)

    def open(self, url: str, link: Link | None) -> VoltageOutput:
        return srs_dc205.open_output(Output(driver="srs_dc205", url=url, timeout_s=TIMEOUT_S), link)


@pytest.mark.parametrize("reach", ["memory"], indirect=True)
class TestDC205WithNumbersInItsLargeRange(TestDC205):
    """The instrument replies 1 where the driver expects ON."""

    limit_V = 100.0

    def instrument(self, put_out: Callable[[float], None]) -> Instrument:
        source = SimulatedDC205(put_out)
        source.answer(b"TOKN OFF")
        return source

    def open(self, url: str, link: Link | None) -> VoltageOutput:
        chosen = Output(driver="srs_dc205", url=url, timeout_s=TIMEOUT_S, options={"range_V": 100})
        return srs_dc205.open_output(chosen, link)


@pytest.mark.parametrize("reach", ["memory"], indirect=True)
class TestI7024WithoutWatchdog(TestI7024):
    def open(self, url: str, link: Link | None) -> VoltageOutput:
        return icpdas_i7024.open_output(settings(url, watchdog_s=0), link)
