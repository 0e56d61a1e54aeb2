"""A stuck sensor is detected within ten samples, and a quiet or creeping arm is not mistaken for
one."""

import random
from math import inf, sin

import pytest

from pincette.core.wording import fault_text, faults_text
from pincette_estimator.config import configure
from pincette_estimator.state import NOISES, SAMPLES, StuckWatch, moved_V
from tests.unit.estimator.bench import Bench, a_rig

MOVED_V = moved_V(0.03, 19.0)


def alarm(readings: list[float], voltages: list[float]) -> int | None:
    """Return the number of the sample at which the detector reports a stuck sensor."""
    watch = StuckWatch()
    for number, (x_um, voltage_V) in enumerate(zip(readings, voltages, strict=True)):
        watch = watch.updated(x_um, voltage_V, MOVED_V)
        if watch.stuck:
            return number
    return None


def test_a_stuck_sensor_is_detected_once_the_voltage_moves_the_arm_by_ten_times_the_noise() -> None:
    assert moved_V(0.03, 19.0) == pytest.approx(NOISES * 0.03 / 19.0)
    assert moved_V(0.0, 19.0) == inf


@pytest.mark.parametrize("step_V", [0.004, 0.02, -0.1])
def test_the_same_reading_while_the_voltage_moves_is_reported_as_stuck(step_V: float) -> None:
    voltages = [step_V * sample for sample in range(20)]
    assert alarm([5.0] * 20, voltages) == SAMPLES - 1


def test_a_quiet_arm_is_not_stuck() -> None:
    assert alarm([5.0] * 5000, [1.0 + 0.005 * sin(sample) for sample in range(5000)]) is None


def test_a_position_held_against_creep_is_not_reported_as_stuck() -> None:
    voltages = [1.0 - 1e-3 * sample for sample in range(5000)]
    assert voltages[0] - voltages[-1] > 100.0 * MOVED_V
    assert alarm([5.0] * 5000, voltages) is None


def test_a_sensor_that_shows_a_step_a_few_samples_late_is_not_reported_as_stuck() -> None:
    voltages = [1.0] * 20 + [1.5] * 20
    for late in range(1, 3):
        readings = [5.0] * (20 + late) + [14.5] * (20 - late)
        assert alarm(readings, voltages) is None
    assert alarm([5.0] * 40, voltages) == 22


def test_a_working_sensor_in_motion_is_never_reported_as_stuck() -> None:
    chance = random.Random(7)
    for speed_um in (0.0, 0.02, 0.08, 0.4):
        moving = [speed_um * sample for sample in range(20000)]
        readings = [round((x + chance.gauss(0.0, 0.03)) / 0.025) * 0.025 for x in moving]
        assert alarm(readings, [x / 19.0 for x in moving]) is None


def test_the_alarm_lasts_until_the_reading_differs() -> None:
    watch = StuckWatch()
    for sample in range(SAMPLES):
        watch = watch.updated(5.0, 0.1 * sample, MOVED_V)
    for _ in range(50):
        watch = watch.updated(5.0, 0.8, MOVED_V)
    assert "sensor stuck: 5.000 µm" in fault_text(watch.fault)
    watch = watch.updated(5.025, 0.8, MOVED_V)
    assert watch.fault is None


def test_a_stuck_sensor_makes_the_estimate_invalid_and_is_named() -> None:
    bench = Bench(configure(a_rig(None)))
    valid = [bench.feed(5.0, 0.05 * sample).valid for sample in range(10)]
    assert valid == [True] * (SAMPLES - 1) + [False] * 3
    assert faults_text(bench.state.findings).startswith("sensor stuck")
    assert bench.feed(5.3, 0.5).valid
    assert bench.state.findings == ()
    bench.arm(2)
    assert bench.feed(5.3, 0.5).valid
