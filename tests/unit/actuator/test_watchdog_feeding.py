"""A monitored output gets heartbeats only while the actuator's rules permit them."""

from pathlib import Path

from msgspec.structs import replace

from pincette.config import read_rig
from pincette.core.faults import Cause
from pincette.core.messages import Trip
from pincette.engine.runner import Runner
from pincette.instruments.protocols import InstrumentError
from pincette_actuator import SERVICE

RIG = read_rig(Path("deploy/rigs/demo.toml"))
T = RIG.rig.period_s


class Watched:
    """An output that counts heartbeats, and may reply with garbage."""

    def __init__(self) -> None:
        self.fed = 0
        self.garbled = False
        self.written_V: list[float] = []

    def write_V(self, voltage_V: float) -> None:
        if self.garbled:
            raise InstrumentError("garbled answer", "garbled")
        self.written_V.append(voltage_V)

    def read_V(self) -> float:
        return 1.0

    def keep_alive(self) -> None:
        self.fed += 1

    def clear_trip(self) -> None: ...

    def close(self) -> None: ...


def waking(runner: Runner, first: int, count: int) -> None:
    for quarter in range(first, first + count):
        runner.tick(quarter * T / 4)


def test_a_latched_actuator_that_holds_its_voltage_continues_to_feed() -> None:
    output = Watched()
    runner = Runner(SERVICE, RIG, output)
    waking(runner, 4, 40)
    assert output.fed >= 9


def test_the_watchdog_is_not_fed_during_an_unconfirmed_ramp() -> None:
    output = Watched()
    runner = Runner(SERVICE, RIG, output)
    waking(runner, 4, 4)
    output.garbled = True
    runner.call(Trip(Cause.ESTOP), 8 * T / 4)
    waking(runner, 8, 1)
    fed = output.fed
    waking(runner, 9, 40)
    assert output.fed == fed
    assert runner.state.unconfirmed
    assert runner.state.mode in ("ramping", "latched")


def test_during_a_freeze_an_unconfirmed_output_gets_heartbeats_and_no_new_voltage() -> None:
    output = Watched()
    runner = Runner(SERVICE, RIG, output)
    runner.state = replace(runner.state, mode="frozen", cause=Cause.DEVICE, unconfirmed=True)
    waking(runner, 4, 40)
    assert output.fed >= 9
    assert output.written_V == []
