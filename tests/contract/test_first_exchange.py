"""One wrong reply, or noise, while a program opens its instrument does not prevent its start."""

from collections.abc import Callable
from itertools import count

import pytest

from pincette.core.messages import Status, StatusRequest
from pincette.core.service import RefusedError
from pincette.engine.instrument import open_device
from pincette.engine.process import CannotStart, loop_services
from pincette.engine.runner import Runner
from pincette.instruments.icpdas_i7024 import I7024
from pincette.instruments.line.counts import LineCounts, counting
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.wires.wire import Garble, serve
from tests.support.rigs import demo_rig

ANY = "socket://127.0.0.1:0"
SERVICES = loop_services()
EXCHANGES = 6
"""Number of exchanges of an output until its program serves, including the voltage that is read
back."""


def nth(number: int, spoil: Callable[[bytes], bytes]) -> Garble:
    """Corrupt one reply."""
    numbers = count()
    return lambda data: spoil(data) if next(numbers) == number else data


def wrong_checksum(data: bytes) -> bytes:
    return data[:-2] + b"Z\r"


def with_noise(data: bytes) -> bytes:
    return b"\xff\x00\r\x80" + data


def cut_off(data: bytes) -> bytes:
    return data[: len(data) // 2]


def status(runner: Runner) -> Status:
    reply, _ = runner.call(StatusRequest(), 0.0)
    assert isinstance(reply, Status)
    return reply


@pytest.mark.parametrize("spoil", [wrong_checksum, with_noise, cut_off])
@pytest.mark.parametrize("number", range(EXCHANGES))
def test_an_output_starts_though_one_of_its_first_answers_is_wrong(
    number: int, spoil: Callable[[bytes], bytes]
) -> None:
    module = SimulatedI7024(lambda _voltage_V: None, lambda: 0.0, checksum=True)
    with serve(ANY, module, garble=nth(number, spoil)) as wire:
        output = {"url": wire.url, "options": {"checksum": True}}
        rig, counts = demo_rig({"output": output}), LineCounts()
        with counting(counts):
            device = open_device(SERVICES["actuator"], rig)
            runner = Runner(SERVICES["actuator"], rig, device, line_counts=counts)
        counted = status(runner).instrument
        runner.close()
    assert counted is not None
    assert counted.retried == 1 or spoil is not wrong_checksum


@pytest.mark.parametrize("spoil", [with_noise, cut_off])
@pytest.mark.parametrize("number", range(2))
def test_a_sensor_starts_though_one_of_its_first_answers_is_wrong(
    number: int, spoil: Callable[[bytes], bytes]
) -> None:
    with serve(ANY, SimulatedKeyence(lambda: 1.0), garble=nth(number, spoil)) as wire:
        rig, counts = demo_rig({"sensor": {"url": wire.url}}), LineCounts()
        with counting(counts):
            device = open_device(SERVICES["sensor"], rig)
            runner = Runner(SERVICES["sensor"], rig, device, line_counts=counts)
        counted = status(runner).instrument
        runner.close()
    assert counted is not None
    assert counted.retried == 1


def test_an_output_that_never_reports_its_voltage_fails_the_start_with_a_reason() -> None:
    module = SimulatedI7024(lambda _voltage_V: None, lambda: 0.0, checksum=True)
    numbers = count()

    def spoil(data: bytes) -> bytes:
        return wrong_checksum(data) if next(numbers) >= EXCHANGES - 1 else data

    with serve(ANY, module, garble=spoil) as wire:
        rig = demo_rig({"output": {"url": wire.url, "options": {"checksum": True}}})
        device = open_device(SERVICES["actuator"], rig)
        with pytest.raises(RefusedError, match="wrong checksum"):
            Runner(SERVICES["actuator"], rig, device)
        assert isinstance(device, I7024)
        device.close()
    assert RefusedError in CannotStart
