import math

import pytest

from pincette.config import Simulation
from pincette.config.simulation import Drift
from pincette.sim.rig.sensor_view import KEPT, Average, drift_um, reading_um


def test_the_average_of_a_ramp_lags_by_half_a_window() -> None:
    average = Average(0.02)
    for index in range(101):
        average.add(0.001 * index, 5.0 * index)
    assert average.mean_um() == pytest.approx(500.0 - 5.0 * 10.0)


def test_the_average_assumes_that_the_arm_was_at_rest_before_its_first_position() -> None:
    average = Average(0.02)
    average.add(1.0, 4.0)
    assert average.mean_um() == pytest.approx(4.0)
    average.add(1.005, 8.0)
    assert average.mean_um() == pytest.approx((4.0 * 0.015 + 6.0 * 0.005) / 0.02)


def test_an_averaging_window_may_begin_between_two_positions() -> None:
    average = Average(0.015)
    for index in range(4):
        average.add(0.01 * index, float(index**2))
    expected = (0.5 * (2.5 + 4.0) * 0.005 + 0.5 * (4.0 + 9.0) * 0.01) / 0.015
    assert average.mean_um() == pytest.approx(expected)


def test_old_positions_are_dropped_and_the_mean_is_kept() -> None:
    average = Average(0.02)
    for index in range(3 * KEPT):
        average.add(0.001 * index, math.sin(0.3 * index))
    short = Average(0.02)
    for index in range(3 * KEPT - 100, 3 * KEPT):
        short.add(0.001 * index, math.sin(0.3 * index))
    assert average.mean_um() == pytest.approx(short.mean_um(), abs=1e-9)


def test_drift_is_a_function_of_time(simulation: Simulation) -> None:
    drift = Drift(slope_um_per_s=0.002, amplitude_um=0.3, cycle_s=400.0)
    drifting = simulation.model_copy(update={"drift": drift})
    assert drift_um(simulation, 1e4) == 0.0
    assert drift_um(drifting, 0.0) == 0.0
    assert drift_um(drifting, 100.0) == pytest.approx(0.2 + 0.3)
    assert drift_um(drifting, 400.0) == pytest.approx(0.8)


def test_a_reading_has_drift_noise_and_whole_steps(simulation: Simulation) -> None:
    drift = Drift(slope_um_per_s=0.01)
    drifting = simulation.model_copy(
        update={"drift": drift, "sensor_step_um": 0.025, "sensor_noise_um": 0.05}
    )
    reading = reading_um(drifting, 3.0, 20.0, lambda index: float(index), 2)
    assert reading == pytest.approx(3.3)
    assert reading_um(drifting, 3.004, 20.0, lambda index: 0.0 * index, 2) == pytest.approx(3.2)
