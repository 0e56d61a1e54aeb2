"""A voltage that is output sample by sample: assignment of positions to voltages."""

from math import pi, sin

import numpy as np
import pytest

from pincette_study.open_loop import drive, peak_to_peak, raised_sinusoid
from pincette_study.rigs import simulation_of
from tests.support.rigs import demo_rig

PERIOD_S, GAIN, STIFFNESS, TOUCH_UM = 0.02, 19.0, 2.2, 5.0
K = 1.0 / 0.46
LINEAR = simulation_of(
    demo_rig(
        {
            "simulation": {
                "piezo_um_per_V": GAIN,
                "compliance_um_per_mN": 0.46,
                "creep_per_decade": 0.0,
                "sensor_noise_um": 0.0,
                "sensor_step_um": 1e-6,
                "output_step_V": 1e-9,
                "output_lag_s": 0.0,
                "damping_ratio": 0.9,
                "hysteresis": {"A_over_d": 0.0},
                "bead_contact_um": TOUCH_UM,
                "environment_stiffness_mN_per_um": STIFFNESS,
            }
        }
    )
)
"""An arm without hysteresis, creep or noise, whose mode decays within a period."""
FREE = LINEAR.model_copy(update={"bead": False})


def test_position_and_voltage_of_a_sample_have_the_same_age() -> None:
    voltages = [0.0, 0.5, 0.5, 1.0, 0.25, 0.25]
    motion = drive(FREE, voltages, PERIOD_S)
    # Before each output: the first sample is taken before the arm has received a voltage.
    assert motion.voltage_V.tolist() == [0.0, 0.0, 0.5, 0.5, 1.0, 0.25]
    assert motion.true_x_um == pytest.approx(GAIN * motion.voltage_V, abs=1e-3)
    assert motion.x_um == pytest.approx(motion.true_x_um, abs=1e-6)
    assert not motion.true_force_mN.any()
    assert motion.period_s == PERIOD_S


def test_a_pressed_part_has_the_force_of_two_springs_in_series() -> None:
    motion = drive(LINEAR, [0.1, 0.1, 0.6, 0.6, 0.6], PERIOD_S)
    free_um = GAIN * 0.6
    pressed_um = (K * free_um + STIFFNESS * TOUCH_UM) / (K + STIFFNESS)
    assert motion.true_force_mN[2] == 0.0
    assert motion.true_x_um[-1] == pytest.approx(pressed_um, abs=1e-3)
    assert motion.true_force_mN[-1] == pytest.approx(STIFFNESS * (pressed_um - TOUCH_UM), abs=1e-2)


def test_the_last_part_of_a_motion_has_the_last_samples_of_each_quantity() -> None:
    motion = drive(LINEAR, [0.1 * tick for tick in range(12)], PERIOD_S)
    tail = motion.tail(4)
    for name in ("voltage_V", "x_um", "true_x_um", "true_force_mN"):
        assert getattr(tail, name).tolist() == getattr(motion, name)[8:].tolist()


def test_a_rig_starts_unpoled_each_time() -> None:
    simulation = simulation_of(demo_rig())
    voltages = raised_sinusoid(2.0, 0.5, 1, PERIOD_S)
    first, second = (drive(simulation, voltages, PERIOD_S) for _ in range(2))
    assert first.x_um.tolist() == second.x_um.tolist()
    assert first.true_x_um[0] == 0.0


def test_a_raised_sinusoid_starts_at_rest_and_has_whole_cycles() -> None:
    voltages = raised_sinusoid(2.0, 0.5, 3, PERIOD_S)
    assert len(voltages) == 300
    assert voltages[0] == 0.0
    assert max(voltages) == pytest.approx(2.0)
    assert voltages[50] == pytest.approx(2.0)
    assert voltages[25] == pytest.approx(1.0)
    assert voltages[100:200] == pytest.approx(voltages[:100], abs=1e-12)


def test_the_peak_to_peak_value_is_correct() -> None:
    assert peak_to_peak(np.array([1.0, -2.5, 0.5])) == 3.5
    swing = np.array([3.0 + 0.7 * sin(0.1 * pi * tick) for tick in range(40)])
    assert peak_to_peak(swing) == pytest.approx(1.4)
