"""Opening an instrument is retried, since a first late reply would otherwise end a program."""

import logging
from contextlib import nullcontext
from math import inf
from typing import Any

import pytest

from pincette.config import ConfigError
from pincette.core import plugins
from pincette.core.faults import Fault
from pincette.core.service import RefusedError, SetVoltage
from pincette.engine import instrument
from pincette.engine.instrument import PAUSE_S, Instrument, open_device
from pincette.engine.process import loop_services
from pincette.instruments.line.counts import LineCounts, counting
from pincette.instruments.protocols import ErrorCode, InstrumentError
from tests.support.rigs import demo_rig

RIG = demo_rig()
SERVICES = loop_services()


class Late:
    """A driver that fails to open this many times, and then returns its settings."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, failures: int, code: ErrorCode = "silent"
    ) -> None:
        self.failures = failures
        self.code: ErrorCode = code
        self.tried = 0

        def load(_group: str, _name: str) -> Any:
            return self.open

        monkeypatch.setattr(plugins, "load", load)

    def open(self, settings: Any) -> Any:
        self.tried += 1
        if self.tried <= self.failures:
            raise InstrumentError("no answer", self.code)
        return settings


# A sensor has a timeout of 16 ms in a tick of 20 ms, a sixth of its usual timeout.
@pytest.mark.parametrize(("name", "tries"), [("sensor", 7), ("actuator", 3)])
@pytest.mark.parametrize("opened", [True, False])
def test_an_instrument_that_does_not_answer_at_once_is_retried(
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    name: str,
    tries: int,
    opened: bool,
) -> None:
    caplog.set_level(logging.INFO)
    driver = Late(monkeypatch, tries - opened)
    with nullcontext() if opened else pytest.raises(InstrumentError):
        open_device(SERVICES[name], RIG)
    assert driver.tried == tries
    assert caplog.text.count("no answer; the next attempt follows") == tries - 1


@pytest.mark.parametrize(("failures", "opened"), [(0, True), (17, True), (18, False)])
def test_a_sensor_with_a_short_timeout_is_retried_for_as_long_as_any_other(
    monkeypatch: pytest.MonkeyPatch, failures: int, opened: bool
) -> None:
    assert RIG.sensor.timeout_s == 0.1
    driver = Late(monkeypatch, failures)
    with nullcontext() if opened else pytest.raises(InstrumentError):
        open_device(SERVICES["sensor"], RIG, 0.0058)
    assert driver.tried == min(failures + 1, 18)


@pytest.mark.parametrize(("at_most_s", "wanted_s"), [(0.006, 0.006), (inf, 0.016)])
def test_the_sensor_is_opened_with_the_shorter_patience(
    monkeypatch: pytest.MonkeyPatch, at_most_s: float, wanted_s: float
) -> None:
    Late(monkeypatch, 0)
    opened: Any = open_device(SERVICES["sensor"], RIG, at_most_s)
    assert opened.timeout_s == pytest.approx(wanted_s)


@pytest.mark.parametrize("name", ["sensor", "actuator"])
def test_opening_over_a_noisy_line_is_retried_with_pauses(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    slept: list[float] = []
    monkeypatch.setattr("pincette.engine.instrument.sleep", slept.append)
    driver, counts = Late(monkeypatch, 2, "garbled"), LineCounts()
    with counting(counts):
        open_device(SERVICES[name], RIG)
    assert driver.tried == 3
    assert slept == [PAUSE_S, PAUSE_S]
    assert counts.retried == 2


class Careless:
    """An external driver that raises built-in exceptions of Python."""

    def __init__(self, _settings: Any = None) -> None:
        pass

    def read_um(self) -> float:
        return float("nonsense")

    def read_V(self) -> float:
        raise KeyError("channel")

    def write_V(self, _voltage_V: float) -> None:
        raise ZeroDivisionError("gain")

    def close(self) -> None:
        pass


def test_an_exception_of_a_driver_is_a_fault_that_names_it() -> None:
    driven = Instrument(Careless(), 0.02, None)
    reading = driven.read()
    assert reading.fault is not None
    assert reading.fault.code == "instrument_garbled"
    assert "ValueError" in str(reading.fault)
    found = driven.put_out(SetVoltage((1.0,)))
    assert isinstance(found, Fault)
    assert "ZeroDivisionError" in str(found)
    with pytest.raises(RefusedError, match="KeyError"):
        driven.read_back()


def test_an_exception_at_opening_is_raised_as_an_error_of_the_instrument(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def load(_group: str, _name: str) -> Any:
        def open_sensor(_settings: Any) -> Any:
            raise AttributeError("vendor library")

        return open_sensor

    monkeypatch.setattr(plugins, "load", load)
    monkeypatch.setattr(instrument, "PAUSE_S", 0.0)
    with pytest.raises(InstrumentError, match="AttributeError"):
        open_device(SERVICES["sensor"], RIG)


def test_an_output_without_shaping_is_refused_if_the_rig_file_requests_shaping(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    closed = list[bool]()

    class Plain:
        def __init__(self, _settings: Any) -> None:
            """Open nothing."""

        def write_V(self, _voltage_V: float) -> None:
            """Output nothing."""

        def read_V(self) -> float:
            return 0.0

        def close(self) -> None:
            closed.append(True)

    def load(_group: str, _name: str) -> type[Plain]:
        return Plain

    monkeypatch.setattr(plugins, "load", load)
    output = RIG.output.model_copy(update={"shaping": True})
    with pytest.raises(ConfigError, match="shaping"):
        open_device(SERVICES["actuator"], RIG.model_copy(update={"output": output}))
    assert closed == [True]
