"""Two drivers on one line: two channels of a module, and modules at addresses of their own."""

from functools import partial
from typing import cast

import pytest

from pincette.config import Output, RigFile
from pincette.core.messages import Applied, Sample
from pincette.engine.instrument import open_device
from pincette.instruments.icpdas_i7024 import open_output
from pincette.instruments.line.shared_line import one_line_for_each_url
from pincette.instruments.protocols import InstrumentError, VoltageOutput
from pincette.sim.bench import open_bench
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.wires.wire import serve
from pincette_actuator import SERVICE as ACTUATOR
from tests.support.rigs import Tree, at_own_ports
from tests.support.two_arms import play, two_arm_rig

ANY = "socket://127.0.0.1:0"


def settings(url: str, channel: int, **options: object) -> Output:
    chosen = {"channel": channel, **options}
    return Output.model_validate({"driver": "icpdas_i7024", "url": url, "options": chosen})


class Module:
    """A module whose channels 0 and 1 drive something."""

    def __init__(self) -> None:
        self.voltages_V, self.now_s = {0: 0.0, 1: 0.0}, 0.0
        self.module = SimulatedI7024(partial(self._put_out, 0), lambda: self.now_s)
        self.module.connect(1, partial(self._put_out, 1))

    def _put_out(self, channel: int, voltage_V: float) -> None:
        self.voltages_V[channel] = voltage_V


def test_two_channels_of_a_module_share_its_line_and_its_watchdog() -> None:
    behind = Module()
    with serve(ANY, behind.module) as wire:
        with one_line_for_each_url():
            first, second = (open_output(settings(wire.url, channel)) for channel in (0, 1))
        first.write_V(1.0)
        second.write_V(2.0)
        assert behind.voltages_V == {0: 1.0, 1: 2.0}
        assert (first.read_V(), second.read_V()) == (1.0, 2.0)
        behind.now_s += 0.7
        for output in (first, second):
            with pytest.raises(InstrumentError, match="watchdog"):
                output.write_V(1.5)
        assert behind.voltages_V == {0: 0.0, 1: 0.0}
        first.clear_trip()
        second.clear_trip()
        first.write_V(0.5)
        second.write_V(0.25)
        assert behind.voltages_V == {0: 0.5, 1: 0.25}
        first.close()
        assert second.read_V() == 0.25
        with pytest.raises(InstrumentError, match="closed"):
            first.read_V()
        second.close()


def test_a_shared_line_that_was_lost_is_prepared_again_for_both_drivers() -> None:
    behind = Module()
    with serve(ANY, behind.module) as wire:
        url = wire.url
        with one_line_for_each_url():
            first, second = (open_output(settings(url, channel)) for channel in (0, 1))
        first.write_V(1.0)
    with pytest.raises(InstrumentError):
        first.write_V(1.0)
    behind.module.power_cycle()
    with serve(url, behind.module):
        second.write_V(2.0)
        first.write_V(1.0)
        assert behind.voltages_V == {0: 1.0, 1: 2.0}
        first.close()
        second.close()


def test_a_driver_that_fails_to_open_does_not_close_the_line_of_the_other() -> None:
    behind = Module()
    with serve(ANY, behind.module) as wire, one_line_for_each_url():
        first = open_output(settings(wire.url, 0))
        with pytest.raises(InstrumentError, match="no answer"):
            open_output(settings(wire.url, 0, address=9))
        first.write_V(1.0)
        first.close()
        again = open_output(settings(wire.url, 1))
        again.write_V(3.0)
        assert behind.voltages_V[1] == 3.0
        again.close()


def on_one_module(rig: RigFile) -> RigFile:
    """The same rig, whose second output is another channel of the first one's module."""
    assert rig.second is not None
    output = rig.second.output.model_copy(
        update={"url": rig.output.url, "options": {"address": 1, "channel": 1}}
    )
    return rig.model_copy(update={"second": rig.second.model_copy(update={"output": output})})


def test_the_actuator_drives_both_arms_over_one_line() -> None:
    rig = on_one_module(at_own_ports(two_arm_rig(time="real")))
    bench = open_bench(rig, lambda: 0.0)
    with bench.offer() as at:
        assert at["output"] == at["second_output"] != at["second_sensor"]
        device = open_device(ACTUATOR, rig)
        assert isinstance(device, tuple)
        first, second = cast(tuple[VoltageOutput, VoltageOutput], device)
        first.write_V(1.0)
        second.write_V(0.5)
        assert (first.read_V(), second.read_V()) == (1.0, 0.5)
        first.close()
        second.close()


def test_a_grip_over_one_module_gives_the_same_result_as_over_two_modules() -> None:
    """All else is equal, except the name of the rig file."""
    rig = two_arm_rig()
    url, options = rig.output.url, {"address": 1, "channel": 1}
    one, _ = play(changes={"second": {"output": {"url": url, "options": options}}})
    two, _ = play()
    assert [item for item in one if isinstance(item, Sample)] == [
        item for item in two if isinstance(item, Sample)
    ]


def test_a_silent_module_is_silent_for_both_arms() -> None:
    rig = two_arm_rig()
    changes: Tree = {
        "output": {"url": rig.output.url},
        "second": {"output": {"url": rig.output.url, "options": {"address": 1, "channel": 1}}},
    }
    off: Tree = {"at_s": 1.0, "target": "second_output", "what": "off"}
    reported, _ = play(off, changes=changes)
    applied = [item for item in reported if isinstance(item, Applied)]
    (fault,) = applied[-1].faults[:1]
    assert fault.number("arm") == 1, (
        "the first channel is written first and already does not answer"
    )
