import math

import pytest

from pincette.config import ConfigError, RigFile, Simulation
from pincette.core.messages import GroundTruth
from pincette.sim.bench import open_bench
from pincette.sim.rig.rig import SimulatedRig, Snapshot, TruthSink

PERIOD_S = 0.02


class Clock:
    """A clock that the test sets."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def _lockstep(simulation: Simulation, truth: TruthSink | None = None) -> SimulatedRig:
    return SimulatedRig(simulation, PERIOD_S, True, Clock(), truth)


def _run(rig: SimulatedRig, looks: int) -> list[float]:
    seen = list[float]()
    for tick in range(200):
        seen.extend([rig.measure_um() for _ in range(looks)][:1])
        rig.put_out(1.2 * (1.0 - math.cos(0.05 * tick)))
    return seen


def test_lockstep_runs_are_bit_identical_with_any_number_of_queries(simulation: Simulation) -> None:
    assert _run(_lockstep(simulation), 1) == _run(_lockstep(simulation), 3)


def test_in_lockstep_the_plant_is_frozen_until_a_write(simulation: Simulation) -> None:
    rig = _lockstep(simulation)
    rig.put_out(1.0)
    assert len({rig.measure_um() for _ in range(10)}) == 1
    assert rig.now_s() == PERIOD_S


def test_the_result_does_not_depend_on_when_the_plant_is_computed(simulation: Simulation) -> None:
    seen = list[tuple[Snapshot, float, float]]()
    for at_once in (False, True):
        rig = _lockstep(simulation)
        for tick in range(50):
            rig.put_out(1.2 * (1.0 - math.cos(0.05 * tick)))
            if at_once:
                rig.pass_time()
                rig.pass_time()
        seen.append((rig.snapshot(), rig.measure_um(), rig.now_s()))
    assert seen[0] == seen[1]


def test_the_previous_voltage_acts_until_the_delay_has_passed(simulation: Simulation) -> None:
    quiet = simulation.model_copy(update={"sensor_noise_um": 0.0, "sensor_step_um": 1e-6})
    at_um = list[float]()
    for delay_s in (0.0, 0.01, PERIOD_S):
        rig = _lockstep(quiet.model_copy(update={"actuation_delay_s": delay_s}))
        rig.put_out(1.0)
        at_um.append(rig.measure_um())
    assert abs(at_um[0]) > 10.0
    assert at_um[0] != at_um[1]
    assert at_um[2] == 0.0


def test_the_true_values_belong_to_the_sample_and_the_voltage_written_for_it(
    simulation: Simulation,
) -> None:
    received = list[GroundTruth]()
    rig = _lockstep(
        simulation.model_copy(update={"sensor_noise_um": 0.0}),
        received.append,
    )
    seen = list[float]()
    for voltage_V in (1.0, 2.4, 2.4, 0.0):
        seen.append(rig.measure_um())
        rig.put_out(voltage_V)
    assert [truth.seq for truth in received] == [0, 1, 2, 3]
    arms = [truth.arms[0] for truth in received]
    assert [arm.x_um for arm in arms] == pytest.approx(seen, abs=0.0126)
    assert [arm.voltage_V for arm in arms] == pytest.approx([1.0, 2.4, 2.4, 0.0], abs=0.0007)
    for arm in arms:
        assert arm.force_mN == pytest.approx(max(0.0, 2.11 * (arm.x_um - 31.2)))
    assert arms[3].force_mN > 0.0


def test_a_reading_is_noisy_and_rounded_to_the_resolution(simulation: Simulation) -> None:
    counts = [x_um / 0.025 for x_um in _run(_lockstep(simulation), 1)]
    assert counts == pytest.approx([round(count) for count in counts], abs=1e-9)
    resting = _lockstep(simulation)
    still = list[float]()
    for _ in range(2000):
        still.append(resting.measure_um())
        resting.put_out(0.0)
    rms_um = math.sqrt(math.fsum(x * x for x in still) / len(still))
    assert rms_um == pytest.approx(math.hypot(0.03, 0.025 / math.sqrt(12.0)), rel=0.06)


def test_in_real_time_the_plant_follows_the_clock(simulation: Simulation) -> None:
    clock = Clock()
    rig = SimulatedRig(simulation, PERIOD_S, False, clock)
    rig.put_out(1.0)
    before_um = rig.measure_um()
    clock.now_s += 1.0
    after_um = rig.measure_um()
    assert abs(before_um) < 0.2
    assert after_um == pytest.approx(18.0, abs=3.0)
    clock.now_s += 36_000.0
    assert 1.02 < rig.measure_um() / after_um < 1.08


def test_a_delay_above_the_period_is_refused(demo: RigFile, simulation: Simulation) -> None:
    slow = simulation.model_copy(update={"actuation_delay_s": 0.03})
    tables = demo.rig.model_copy(update={"time": "lockstep"})
    with pytest.raises(ConfigError, match=r"actuation_delay_s = 0\.03 s is above the period"):
        open_bench(demo.model_copy(update={"simulation": slow, "rig": tables}), Clock())


def test_a_bench_needs_a_simulation_and_known_drivers(demo: RigFile) -> None:
    with pytest.raises(ConfigError, match=r"\[simulation\] is missing"):
        open_bench(demo.model_copy(update={"simulation": None}), Clock())
    other = demo.sensor.model_copy(update={"driver": "other"})
    with pytest.raises(ConfigError, match=r"sensor.driver = 'other': only 'keyence_lkg'"):
        open_bench(demo.model_copy(update={"sensor": other}), Clock())
