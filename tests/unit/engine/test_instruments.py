"""The instruments of two arms: read and written in a tick, and each fault states its arm."""

from typing import Any

import pytest

from pincette.core.faults import Fault
from pincette.core.messages import Arm, Position
from pincette.core.service import CheckWave, PutOut, ReadBack, RefusedError, SetVoltage, Wave
from pincette.core.wording import fault_text
from pincette.engine.instrument import ReadingWatch
from pincette.engine.instruments import Instruments
from pincette.engine.runner import Runner
from pincette.instruments.protocols import InstrumentError
from pincette_sensor import SERVICE as SENSOR
from tests.support.two_arms import two_arm_rig


class Device:
    """A sensor or a monitored output, which fails on request."""

    def __init__(self, value: float = 0.0) -> None:
        self.value = value
        self.fails = False
        self.fed, self.cleared, self.closed = 0, 0, False

    def _try(self) -> None:
        if self.fails:
            raise InstrumentError("no answer", "silent")

    def read_um(self) -> float:
        self._try()
        return self.value

    def write_V(self, voltage_V: float) -> None:
        self._try()
        self.value = voltage_V

    def read_V(self) -> float:
        self._try()
        return self.value

    def keep_alive(self) -> None:
        self._try()
        self.fed += 1

    def clear_trip(self) -> None:
        self._try()
        self.cleared += 1

    def close(self) -> None:
        self.closed = True


def pair() -> tuple[Instruments, Device, Device]:
    one, two = Device(1.0), Device(2.0)
    devices: Any = (one, two)
    return Instruments(devices, 0.02, ReadingWatch(0.02, lambda: 0.0)), one, two


def test_both_sensors_are_read_and_each_fault_belongs_to_its_arm() -> None:
    both, one, two = pair()
    assert [arm.x_um for arm in both.read().arms] == [1.0, 2.0]
    one.fails = two.fails = True
    first, second = both.read().arms
    assert fault_text(first.fault) == "first arm: no answer"
    assert fault_text(second.fault) == "second arm: no answer"


def test_the_second_output_is_written_only_if_the_first_has_confirmed() -> None:
    both, one, two = pair()
    assert both.put_out(SetVoltage((0.5, 0.7))) is None
    assert (one.value, two.value) == (0.5, 0.7)
    one.fails = True
    assert fault_text(as_fault(both.put_out(SetVoltage((0.1, 0.1))))) == "first arm: no answer"
    assert two.value == 0.7
    one.fails, two.fails = False, True
    assert fault_text(as_fault(both.put_out(SetVoltage((0.1, 0.1))))) == "second arm: no answer"
    assert one.value == 0.1


def as_fault(said: Fault | PutOut | None) -> Fault:
    assert isinstance(said, Fault)
    return said


def test_both_outputs_are_read_back_or_neither() -> None:
    both, _, two = pair()
    assert both.put_out(ReadBack()) == PutOut((1.0, 2.0))
    assert both.recover() == PutOut((1.0, 2.0))
    two.fails = True
    assert fault_text(as_fault(both.put_out(ReadBack()))) == "second arm: no answer"
    with pytest.raises(RefusedError, match="the second arm: the voltage output cannot be read"):
        both.read_back()
    with pytest.raises(RefusedError, match="the second arm: the voltage output cannot be reset"):
        both.recover()


def test_a_wave_is_never_played_by_the_second_arm() -> None:
    both, _, two = pair()
    for order in (Wave((1.0,), 100.0), CheckWave()):
        assert "first arm: the voltage output cannot play waves" in fault_text(
            as_fault(both.put_out(order))
        )
    assert two.value == 2.0


def test_neither_watchdog_is_fed_if_the_first_output_does_not_reply() -> None:
    both, one, two = pair()
    assert both.keep_alive(1.0) is None
    assert (one.fed, two.fed) == (1, 1)
    one.fails = True
    assert fault_text(both.keep_alive(1.1)) == "first arm: no answer"
    assert two.fed == 1


def test_two_arms_refuse_an_acquisition_and_close_both_instruments() -> None:
    both, one, two = pair()
    both.capture(0.0)
    with pytest.raises(RefusedError, match="a rig of two arms has none"):
        both.capture(1000.0)
    both.close()
    assert (one.closed, two.closed) == (True, True)


def positions(*values_um: tuple[float, float]) -> list[Position]:
    rig = two_arm_rig({"second": {"sensor": {"direction": -1, "offset_um": 1.0}}})
    one, two = Device(), Device()
    devices: Any = (one, two)
    runner = Runner(SENSOR, rig, devices)
    runner.call(Arm(3, 7, rig.digest()), 0.0)
    found: list[Position] = []
    for number, (one.value, two.value) in enumerate(values_um):
        (position,) = runner.tick(0.02 * number)
        assert isinstance(position, Position)
        found.append(position)
    assert runner.state.refused == sum(not position.usable for position in found)
    return found


def test_the_second_arm_has_the_opposite_direction() -> None:
    (position,) = positions((5.0, -3.0))
    assert len(position.arms) == 2
    assert (position.arms[0].x_um, position.arms[1].x_um, position.usable) == (5.0, 4.0, True)


def test_a_sample_of_two_arms_is_usable_if_both_are_measured() -> None:
    first, second = positions((5.0, 1e5), (1e5, 3.0))
    assert len(first.arms) == 2
    assert len(second.arms) == 2
    assert (first.arms[0].valid, first.arms[1].valid, first.usable) == (True, False, False)
    assert "second arm: position 100000.000 µm is outside" in fault_text(first.arms[1].fault)
    assert (second.arms[0].valid, second.arms[1].valid, second.usable) == (False, True, False)
