"""The rig program as a device server: both drivers use the same device at one port."""

from pathlib import Path

import pytest

from pincette.config import ConfigError, RigFile
from pincette.config.reading import laid_over
from pincette.core.messages import SimCommand
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.protocols import PartsOutput
from pincette.sim.bench import open_bench
from pincette.sim.instruments.keyence import SimulatedKeyence
from pincette.sim.rig.rig import SimulatedRig
from pincette.sim.script.script import Script
from pincette_nidaqmx.position_sensor import open_sensor
from pincette_nidaqmx.voltage_output import open_output
from tests.support.rig_program import truths_of_three_writes
from tests.support.rigs import Tree, at_own_ports, demo_rig

pytestmark = pytest.mark.usefixtures("stalls")

PAIR: Tree = {
    "sensor": {
        "driver": "nidaqmx",
        "url": "grpc://127.0.0.1:7461/cDAQ1Mod1/ai0",
        "timeout_s": 0.5,
        "options": {"um_per_V": 10.0, "drive_channel": "cDAQ1Mod1/ai1"},
    },
    "output": {
        "driver": "nidaqmx",
        "url": "grpc://127.0.0.1:7461/cDAQ1Mod2/ao0",
        "timeout_s": 0.5,
        "options": {},
    },
    "simulation": {"output_step_V": 20.0 / 65536, "output_lag_s": 3e-6},
}
RATE_HZ = 1000.0


def fast_rig(pace: str, changes: Tree | None = None) -> RigFile:
    """The demo rig with the fast instruments, at separate ports."""
    demo = demo_rig(time=pace)
    tree = demo.model_dump(mode="json", exclude_unset=True)
    for table in ("sensor", "output"):
        tree[table]["options"] = {}
    own = laid_over(laid_over(tree, PAIR), changes or {})
    return at_own_ports(RigFile.model_validate(own))


@pytest.mark.parametrize("pace", ["lockstep", "real"])
def test_each_write_over_the_line_reaches_the_simulated_rig_once(tmp_path: Path, pace: str) -> None:
    rig = fast_rig(pace)
    reported = truths_of_three_writes(
        rig, tmp_path, lambda: open_sensor(rig.sensor), lambda: open_output(rig.output)
    )
    assert [truth.seq for truth in reported] == [0, 1, 2]
    step_V = 20.0 / 65536
    assert [truth.arms[0].voltage_V for truth in reported] == pytest.approx(
        [1.0, 1.0, 0.5], abs=step_V
    )


def test_in_lockstep_a_capture_records_the_wave_that_is_played() -> None:
    rig = fast_rig("lockstep", {"simulation": {"sensor_noise_um": 0.0}})
    bench = open_bench(rig, lambda: 0.0)
    sensor = open_sensor(rig.sensor, MemoryLink(bench.sensor.answer, None))
    output = open_output(rig.output, MemoryLink(bench.output.answer, None))
    sensor.begin_capture(RATE_HZ)
    assert len(sensor.read_block().x_um) == 1
    output.begin_wave([0.5] * 25 + [0.25], RATE_HZ)
    blocks = [sensor.read_block()]
    for _ in range(2):
        output.look()
        blocks.append(sensor.read_block())
    assert [len(block.x_um) for block in blocks] == [20, 20, 20]
    assert blocks[0].drive_V[-1] == pytest.approx(0.5, abs=0.001)
    assert blocks[2].drive_V[-1] == pytest.approx(0.25, abs=0.001)
    assert output.read_V() == 0.25
    assert bench.rig.now_s() == pytest.approx(0.06)


@pytest.mark.parametrize(
    ("after_s", "held_V"), [(0.0005, 0.25), (0.0015, 0.75), (0.0025, 1.0), (0.5, 1.0)]
)
def test_the_output_follows_the_voltages_of_a_step_and_a_write_cancels_the_remaining_ones(
    after_s: float, held_V: float
) -> None:
    rig, now_s = fast_rig("real"), [5.0]
    bench = open_bench(rig, lambda: now_s[0])
    assert isinstance(bench.rig, SimulatedRig)
    output = open_output(rig.output, MemoryLink(bench.output.answer, None))
    assert isinstance(output, PartsOutput)
    output.write_parts((0.25, 0.75, 1.0), 0.001)
    now_s[0] += after_s
    assert bench.rig.snapshot().voltage_V == pytest.approx(held_V, abs=1e-3)
    output.write_V(0.25)
    now_s[0] += 0.1
    assert bench.rig.snapshot().voltage_V == pytest.approx(0.25, abs=1e-3)
    output.close()


def test_a_simulated_sensor_fault_on_a_shared_device_does_not_affect_the_output() -> None:
    rig = fast_rig("lockstep")
    script = Script(timeouts_s={"sensor": 0.1, "output": 0.1})
    bench = open_bench(rig, lambda: 0.0, None, script)
    front = bench.fitted["sensor"].server
    assert front is not None
    assert front is bench.fitted["output"].server
    sensor = open_sensor(rig.sensor, MemoryLink(front.answer, None))
    output = open_output(rig.output, MemoryLink(front.answer, None))
    assert script.order(SimCommand("sensor", "off")) == ""
    with pytest.raises(Exception, match="no answer") as caught:
        sensor.read_um()
    assert getattr(caught.value, "code", "") == "silent"
    output.write_V(0.5)
    assert script.order(SimCommand("sensor", "heal")) == ""
    assert sensor.read_um() > 1.0


def test_each_pair_of_drivers_works_with_its_instruments() -> None:
    rig = fast_rig("real")
    shared = open_bench(rig, lambda: 0.0)
    assert shared.sensor is shared.output
    apart = fast_rig("real", {"output": {"url": "grpc://elsewhere:7462/cDAQ1Mod2/ao0"}})
    moved = apart.model_copy(
        update={"output": apart.output.model_copy(update={"url": "grpc://b:1/cDAQ1Mod2/ao0"})}
    )
    two = open_bench(moved, lambda: 0.0)
    assert two.sensor is not two.output
    demo = demo_rig()
    mixed = open_bench(demo.model_copy(update={"output": rig.output}), lambda: 0.0)
    assert isinstance(mixed.sensor, SimulatedKeyence)
    assert mixed.fitted["sensor"].server is None
    assert mixed.fitted["output"].terminator is None


def test_a_serial_line_has_the_speed_that_its_driver_states() -> None:
    demo = demo_rig({"sensor": {"options": {"baud": 38400}}, "simulation": {"baud": 115200}})
    own = open_bench(demo, lambda: 0.0).fitted
    assert (own["sensor"].baud, own["output"].baud) == (115200, 115200)
    assert demo.simulation is not None
    left = demo.simulation.model_dump(exclude={"baud"}, exclude_unset=True)
    unsaid = RigFile.model_validate(demo.model_dump(exclude_unset=True) | {"simulation": left})
    both = open_bench(unsaid, lambda: 0.0).fitted
    assert (both["sensor"].baud, both["output"].baud) == (38400, 115200)
    lockstep = open_bench(demo_rig(time="lockstep"), lambda: 0.0).fitted
    assert lockstep["sensor"].baud is None


def test_a_monitor_without_a_scale_is_refused() -> None:
    rig = fast_rig("real")
    bare = rig.sensor.model_copy(update={"options": {}})
    with pytest.raises(ConfigError, match="um_per_V is missing"):
        open_bench(rig.model_copy(update={"sensor": bare}), lambda: 0.0)
