"""A watched output hears that its host lives only while the actuator's rules say that it does."""

from pathlib import Path

from msgspec.structs import replace

from pincette.config import read_rig
from pincette.core.faults import Cause
from pincette.core.messages import Trip
from pincette.engine.node import Node
from pincette.instruments.protocols import InstrumentError
from pincette_actuator import SERVICE

RIG = read_rig(Path("deploy/rigs/demo.toml"))
T = RIG.rig.period_s


class Watched:
    """An output that counts heartbeats, and may answer with garbage."""

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


def waking(node: Node, first: int, count: int) -> None:
    for quarter in range(first, first + count):
        node.wake(quarter * T / 4)


def test_a_latched_actuator_that_holds_its_voltage_goes_on_to_feed() -> None:
    output = Watched()
    node = Node(SERVICE, RIG, output)
    waking(node, 4, 40)
    assert output.fed >= 9


def test_a_ramp_that_the_output_does_not_confirm_is_left_to_its_watchdog() -> None:
    output = Watched()
    node = Node(SERVICE, RIG, output)
    waking(node, 4, 4)
    output.garbled = True
    node.call(Trip(Cause.ESTOP), 8 * T / 4)
    waking(node, 8, 1)
    fed = output.fed
    waking(node, 9, 40)
    assert output.fed == fed
    assert node.state.unconfirmed
    assert node.state.mode in ("ramping", "latched")


def test_a_freeze_is_kept_alive_by_heartbeats_alone() -> None:
    output = Watched()
    node = Node(SERVICE, RIG, output)
    node.state = replace(node.state, mode="frozen", cause=Cause.DEVICE, unconfirmed=True)
    waking(node, 4, 40)
    assert output.fed >= 9
    assert output.written_V == []
