"""Exchanges with slow instruments are measured over real ports, and a loop that is too slow is
refused before any motion."""

from collections.abc import Callable, Generator
from contextlib import closing, contextmanager
from time import monotonic, sleep

import pytest

from pincette.config import RigFile
from pincette.core import plugins
from pincette.core.messages import Ack, Arm, Reset, Status, StatusRequest
from pincette.diagnostics.instruments import instruments
from pincette.engine.instrument import open_device
from pincette.engine.runner import Runner
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.wires.wire import serve
from tests.support.rigs import demo_rig

ANY = "socket://127.0.0.1:0"


class Slow:
    """An instrument that replies to each request after a time."""

    def __init__(self, instrument: Instrument, delay_s: float) -> None:
        self._instrument, self._delay_s = instrument, delay_s

    def idle(self) -> None:
        self._instrument.idle()

    def answer(self, line: bytes) -> bytes | None:
        reply = self._instrument.answer(line)
        if reply is not None:
            sleep(self._delay_s)
        return reply


@contextmanager
def bench(reading_s: float, exchange_s: float) -> Generator[RigFile]:
    """Serve the instruments of the demo rig with these durations."""
    laser = Slow(SimulatedKeyence(lambda: 5.0 + monotonic() % 0.1), reading_s)
    module = Slow(SimulatedI7024(lambda _voltage_V: None, monotonic), exchange_s)
    with serve(ANY, laser) as sensor, serve(ANY, module) as output:
        at_output = {"url": output.url, "options": {"watchdog_s": 0.0}}
        yield demo_rig({"sensor": {"url": sensor.url}, "output": at_output})


@pytest.mark.parametrize(
    ("reading_s", "exchange_s", "fits"),
    [(0.0, 0.0, True), (0.027, 0.0, False), (0.0, 0.024, False)],
)
def test_doctor_compares_the_period_with_what_it_measures(
    reading_s: float, exchange_s: float, *, fits: bool
) -> None:
    with bench(reading_s, exchange_s) as rig:
        found = list(instruments(rig))
    timing = found[-1]
    assert timing.ok == fits, timing.what
    slow_s = max(reading_s, exchange_s)
    part = "sensor" if reading_s else "output"
    (margin,) = (one for one in found if one.what.startswith(part) and "median" in one.what)
    assert (margin.mark == "missing") == (not fits), margin.what
    if not fits:
        assert f"{1e3 * slow_s:.0f}." in margin.what
        assert "(measured, stated 1." in timing.what
        url = rig.sensor.url if reading_s else rig.output.url
        assert url in margin.what
        assert url in timing.remedy


def armed(rig: RigFile, name: str, prepare: Callable[[Runner], object]) -> tuple[object, Status]:
    """Arm a program of the loop that has an instrument; returns its reply and its status."""
    service = plugins.load(plugins.SERVICES, name)
    with closing(Runner(service, rig, open_device(service, rig))) as runner:
        prepare(runner)
        reply, _ = runner.call(Arm(1, 1, rig.digest()), monotonic())
        status, _ = runner.call(StatusRequest(), monotonic())
    assert isinstance(status, Status)
    return reply, status


def reset(runner: Runner) -> None:
    runner.call(Reset(acknowledge=True), monotonic())


def read(runner: Runner) -> None:
    for _ in range(10):
        runner.tick(monotonic())


@pytest.mark.parametrize(("exchange_s", "refused"), [(0.0, False), (0.024, True)])
def test_an_actuator_whose_output_is_measured_to_be_too_slow_is_not_armed(
    exchange_s: float, *, refused: bool
) -> None:
    with bench(0.0, exchange_s) as rig:
        reply, status = armed(rig, "actuator", reset)
    (took,) = status.exchanges
    assert took.minimum_s >= exchange_s
    assert took.minimum_s <= took.median_s <= took.worst_s
    assert isinstance(reply, str if refused else Ack), reply
    assert "measured, stated 1.2" in str(reply) or not refused


@pytest.mark.parametrize("reading_s", [0.0, 0.012])
def test_a_sensor_reports_its_measured_latency_and_is_armed_if_the_loop_has_time(
    reading_s: float,
) -> None:
    with bench(reading_s, 0.0) as rig:
        reply, status = armed(rig, "sensor", read)
    (took,) = status.exchanges
    # A reading that a busy machine delays beyond its timeout is not counted.
    assert 5 <= took.count <= 10
    assert took.minimum_s >= reading_s
    assert isinstance(reply, Ack), reply
