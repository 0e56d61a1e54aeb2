"""The driver of the how-to guide satisfies the contract of a position sensor."""

import importlib.util
from collections.abc import Callable
from pathlib import Path

import pytest

from pincette.config import ConfigError, Sensor
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.protocols import InstrumentError, Link, PositionSensor
from pincette.sim.instruments.protocol import Instrument
from tests.contract.test_position_sensor import PositionSensorContract
from tests.support.example_lds import SimulatedLDS

FILE = Path(__file__).parents[2] / "docs/examples/driver/pincette_example_lds.py"


def _open_sensor() -> Callable[[Sensor, Link | None], PositionSensor]:
    spec = importlib.util.spec_from_file_location(FILE.stem, FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.open_sensor


open_sensor = _open_sensor()


def settings(url: str = "memory://", /, **options: str | float | bool) -> Sensor:
    return Sensor(
        driver="example_lds",
        url=url,
        minimum_um=-9999.0,
        maximum_um=9999.0,
        timeout_s=0.1,
        noise_um=0.03,
        options=dict(options),
    )


class TestExampleDriver(PositionSensorContract):
    step_um, far_um = 0.01, 100_000.0

    def instrument(self, measure: Callable[[], float | None]) -> Instrument:
        return SimulatedLDS(measure, head=2)

    def open(self, url: str, link: Link | None) -> PositionSensor:
        return open_sensor(settings(url, head=2), link)


def test_a_sensor_head_with_another_address_does_not_answer() -> None:
    sensor = open_sensor(settings(head=1), MemoryLink(SimulatedLDS(lambda: 0.0, head=2).answer))
    with pytest.raises(InstrumentError, match="no answer"):
        sensor.read_um()


def test_a_different_instrument_at_the_port_is_refused_at_opening() -> None:
    link = MemoryLink(lambda _line: b"MS,01,+0001.00")
    with pytest.raises(InstrumentError, match="is not the name of an LDS"):
        open_sensor(settings(), link)
    with pytest.raises(InstrumentError, match="port is closed"):
        link.exchange(b"*IDN?")


@pytest.mark.parametrize(("option", "value"), [("head", 5), ("head", "1"), ("colour", "red")])
def test_impossible_options_are_refused(option: str, value: str | int) -> None:
    with pytest.raises(ConfigError, match=f"example_lds option {option} = {value!r}"):
        open_sensor(settings(**{option: value}), None)
