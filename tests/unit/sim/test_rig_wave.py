"""Buffered output and acquisition of a simulated rig."""

import math
from dataclasses import replace

import pytest

from pincette.config import Simulation
from pincette.config.simulation import Drift, SecondMode
from pincette.core.messages import GroundTruth
from pincette.sim.plant import plant
from pincette.sim.rig.capture import CaptureOverflowError
from pincette.sim.rig.rig import SimulatedRig

PERIOD_S = 0.02
RATE_HZ = 10_000.0
SWEPT = [0.05 * math.sin(0.001 * index**1.5) for index in range(1000)]


@pytest.fixture
def fast(simulation: Simulation) -> Simulation:
    """Return a rig with two arms whose output is fast and whose sensor is quiet."""
    return simulation.model_copy(
        update={
            "sensor_noise_um": 0.0,
            "sensor_step_um": 1e-9,
            "output_step_V": 1e-6,
            "output_lag_s": 3e-6,
            "actuation_delay_s": 0.0,
            "second_mode": SecondMode(share=0.0255),
            "passive_natural_frequency_rad_per_s": 2437.8,
        }
    )


def _lockstep(simulation: Simulation, period_s: float = PERIOD_S) -> SimulatedRig:
    return SimulatedRig(simulation, period_s, True, lambda: 0.0)


def test_a_wave_equals_the_same_voltages_written_one_by_one(fast: Simulation) -> None:
    by_wave, by_hand = _lockstep(fast), _lockstep(fast, 1.0 / RATE_HZ)
    by_wave.put_out_wave(SWEPT, RATE_HZ)
    for _ in range(4):
        by_wave.go_on()
    for voltage_V in SWEPT:
        by_hand.put_out(voltage_V)
    assert by_wave.now_s() == pytest.approx(by_hand.now_s())
    assert by_wave.snapshot().x_um == pytest.approx(by_hand.snapshot().x_um, abs=1e-12)
    assert by_wave.wave_over


def test_the_last_voltage_of_a_wave_is_kept_and_a_single_write_ends_a_running_wave(
    fast: Simulation,
) -> None:
    rig = _lockstep(fast)
    rig.put_out_wave([0.1, 0.2, 0.3], 100.0)
    assert not rig.wave_over
    assert rig.snapshot().voltage_V == pytest.approx(0.2)
    rig.go_on()
    assert rig.wave_over
    rig.go_on()
    assert rig.snapshot().voltage_V == pytest.approx(0.3)
    rig.put_out_wave([0.5] * 1000, 100.0)
    rig.put_out(-0.25)
    assert rig.wave_over
    assert rig.snapshot().voltage_V == pytest.approx(-0.25)


def test_the_previous_voltage_acts_until_the_delay_has_passed(fast: Simulation) -> None:
    late = _lockstep(fast.model_copy(update={"actuation_delay_s": 0.005}))
    late.begin_capture(1000.0)
    late.put_out_wave([0.1, 0.2], 200.0)
    _, drive_V = late.drain()
    expected = [0.0] * 5 + [0.1] * 5 + [0.2] * 10
    assert drive_V == pytest.approx(expected, abs=1e-6)


def test_each_tick_has_a_ground_truth(fast: Simulation) -> None:
    received = list[tuple[int, float]]()

    def tell(truth: GroundTruth) -> None:
        received.append((truth.seq, truth.arms[0].voltage_V))

    rig = SimulatedRig(fast, PERIOD_S, True, lambda: 0.0, tell)
    rig.put_out_wave([0.1, 0.4], 50.0)
    rig.go_on()
    rig.go_on()
    assert received == [(0, pytest.approx(0.1)), (1, pytest.approx(0.4)), (2, pytest.approx(0.4))]
    assert rig.now_s() == pytest.approx(3 * PERIOD_S)


def test_captured_samples_equal_the_positions_of_the_simulated_arm(fast: Simulation) -> None:
    rig = _lockstep(fast)
    rig.begin_capture(RATE_HZ)
    rig.put_out_wave(SWEPT, RATE_HZ)
    x_um, drive_V = rig.drain()
    for _ in range(4):
        rig.go_on()
    more_um, more_V = rig.drain()
    assert (len(x_um), len(more_um)) == (200, 800)
    # The wave begins with the first sample of the capture, which is one period after its start.
    _, expected_um, expected_V = plant.play(
        plant.plant_parameters(fast), plant.start(), 1e-4, [0.0, *SWEPT[:-1]]
    )
    assert x_um + more_um == pytest.approx(expected_um, abs=1e-9)
    assert drive_V + more_V == pytest.approx(expected_V, abs=1e-12)
    assert rig.drain() == ([], [])


def test_no_sample_is_lost_on_a_grid_shifted_from_the_ticks(simulation: Simulation) -> None:
    rig = _lockstep(simulation)
    rig.put_out(0.3)
    rig.begin_capture(333.0)
    count = 0
    for tick in range(1, 500):
        rig.put_out(0.3)
        count += len(rig.drain()[0])
        assert count == math.floor(tick * PERIOD_S * 333.0 + 1e-9)


def test_captured_noise_is_independent_and_reproducible(simulation: Simulation) -> None:
    def run(drained: int) -> list[float]:
        rig, seen = _lockstep(simulation), list[float]()
        rig.begin_capture(2000.0)
        for tick in range(40):
            rig.measure_um()
            rig.put_out(0.0)
            if tick % drained == 0:
                seen += rig.drain()[0]
        return seen + rig.drain()[0]

    assert run(1) == run(7)
    values = run(1)
    rms_um = math.sqrt(math.fsum(x * x for x in values) / len(values))
    assert rms_um == pytest.approx(math.hypot(0.03, 0.025 / math.sqrt(12.0)), rel=0.06)
    single = _lockstep(simulation)
    assert values[0] != single.measure_um() or values[1] != values[0]


def test_the_average_and_drift_of_the_sensor_are_captured_too(fast: Simulation) -> None:
    still = fast.model_copy(
        update={"averaging_s": 0.01, "drift": Drift(slope_um_per_s=0.5), "substep_s": 1e-4}
    )
    rig = _lockstep(still)
    rig.begin_capture(1000.0)
    for tick in range(25):
        rig.put_out(0.02 * tick)
    x_um, _ = rig.drain()
    plain = _lockstep(fast.model_copy(update={"substep_s": 1e-4}))
    plain.begin_capture(RATE_HZ)
    for tick in range(25):
        plain.put_out(0.02 * tick)
    fine_um, _ = plain.drain()
    # The trapezoids of a window of 10 ms at 0.1 ms, ending at 0.4 s.
    window = fine_um[3899:4000]
    mean_um = (math.fsum(window) - 0.5 * (window[0] + window[-1])) / 100.0
    assert x_um[399] == pytest.approx(mean_um + 0.5 * 0.4, abs=1e-4)


def test_a_capture_is_started_once_and_drained_in_time(simulation: Simulation) -> None:
    rig = _lockstep(simulation)
    with pytest.raises(ValueError, match="no capture is running"):
        rig.drain()
    rig.begin_capture(50.0)
    with pytest.raises(ValueError, match="a capture is running"):
        rig.begin_capture(50.0)
    for _ in range(3100):
        rig.put_out(0.0)
    with pytest.raises(CaptureOverflowError, match=r"100 samples were lost: .* 3000 samples, 60 s"):
        rig.drain()
    rig.put_out(0.0)
    assert len(rig.drain()[0]) == 1
    rig.end_capture()
    rig.end_capture()
    with pytest.raises(ValueError, match="no capture is running"):
        rig.drain()


@pytest.mark.parametrize(
    ("voltages_V", "rate_hz", "said"),
    [
        ([], 100.0, "at least one voltage"),
        ([0.0, math.nan], 100.0, "voltage 1 of the wave is nan V"),
        ([0.0], 0.0, r"rate_hz = 0\.0 Hz"),
    ],
)
def test_an_impossible_wave_is_refused_before_anything_happens(
    simulation: Simulation, voltages_V: list[float], rate_hz: float, said: str
) -> None:
    rig = _lockstep(simulation)
    with pytest.raises(ValueError, match=said):
        rig.put_out_wave(voltages_V, rate_hz)
    assert rig.now_s() == 0.0


def test_in_real_time_a_wave_follows_the_clock(fast: Simulation) -> None:
    now_s = [7.0]
    rig = SimulatedRig(fast, PERIOD_S, False, lambda: now_s[0])
    rig.begin_capture(RATE_HZ)
    rig.put_out_wave(SWEPT, RATE_HZ)
    rig.go_on()
    count = 0
    for passed_s in (0.0123, 0.0456, 0.09, 0.1, 3.0):
        now_s[0] = 7.0 + passed_s
        count += len(rig.drain()[0])
        assert count == math.floor(passed_s * RATE_HZ + 1e-6)
        # It has begun with the first sample of the capture.
        assert rig.wave_over == (passed_s > 0.1)
    played = replace(rig.snapshot(), time_s=0.0)
    assert played.voltage_V == pytest.approx(SWEPT[-1], abs=1e-6)
