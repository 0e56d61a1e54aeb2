"""Instruments are opened with patience: a first answer may be late, which would end a program."""

import logging
from contextlib import nullcontext
from math import inf
from typing import Any

import pytest

from pincette.core import plugins
from pincette.engine.instrument import open_device
from pincette.engine.process import loop_services
from pincette.instruments.protocols import InstrumentError
from tests.support.rigs import demo_rig

RIG = demo_rig()
SERVICES = loop_services()


class Late:
    """A driver that fails to open so often, and then gives its settings back."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, failures: int) -> None:
        self.failures = failures
        self.tried = 0

        def load(_group: str, _name: str) -> Any:
            return self.open

        monkeypatch.setattr(plugins, "load", load)

    def open(self, settings: Any) -> Any:
        self.tried += 1
        if self.tried <= self.failures:
            raise InstrumentError("no answer")
        return settings


@pytest.mark.parametrize("name", ["sensor", "actuator"])
@pytest.mark.parametrize(("failures", "opened"), [(0, True), (2, True), (3, False)])
def test_one_that_does_not_answer_at_once_is_asked_again(
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    name: str,
    failures: int,
    opened: bool,
) -> None:
    caplog.set_level(logging.INFO)
    driver = Late(monkeypatch, failures)
    with nullcontext() if opened else pytest.raises(InstrumentError):
        open_device(SERVICES[name], RIG)
    assert driver.tried == min(failures + 1, 3)
    assert caplog.text.count("no answer; it is tried again") == min(failures, 2)


@pytest.mark.parametrize(("failures", "opened"), [(0, True), (17, True), (18, False)])
def test_a_sensor_that_is_waited_for_shortly_is_asked_as_long_as_any_other(
    monkeypatch: pytest.MonkeyPatch, failures: int, opened: bool
) -> None:
    assert RIG.sensor.timeout_s == 0.1
    driver = Late(monkeypatch, failures)
    with nullcontext() if opened else pytest.raises(InstrumentError):
        open_device(SERVICES["sensor"], RIG, 0.0058)
    assert driver.tried == min(failures + 1, 18)


@pytest.mark.parametrize(("at_most_s", "wanted_s"), [(0.006, 0.006), (inf, RIG.sensor.timeout_s)])
def test_the_sensor_is_opened_with_the_shorter_patience(
    monkeypatch: pytest.MonkeyPatch, at_most_s: float, wanted_s: float
) -> None:
    Late(monkeypatch, 0)
    opened: Any = open_device(SERVICES["sensor"], RIG, at_most_s)
    assert opened.timeout_s == wanted_s
