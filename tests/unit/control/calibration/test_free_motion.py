"""Secant gain, loop and creep of known motions."""

from math import pi

import numpy as np
import pytest

from pincette.control.calibration.free_motion import creep_after_step, secant_gain
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import simulate

ELLIPSE_RAD = 0.2


def test_an_ellipse_has_the_requested_gain_and_width() -> None:
    phase = 2.0 * pi * np.arange(500) / 100.0
    u, x = np.sin(phase), 19.0 * np.sin(phase - ELLIPSE_RAD) + 40.0
    found = secant_gain(u, x, 100.0)
    assert found.gain_um_per_V == pytest.approx(19.0, rel=1e-4)
    # x at mean voltage is ± 19·sin 0.2 on the two branches.
    assert found.loop_percent == pytest.approx(100.0 * np.sin(ELLIPSE_RAD), rel=2e-3)
    assert found.voltage_pp_V == pytest.approx(2.0, rel=1e-4)


def test_the_kinks_of_plays_do_not_bias_the_gain() -> None:
    model = HysteresisModel((0.0, 0.2, 0.4, 0.6), (12.0, 3.0, 3.0, 3.0))
    u = np.sin(2.0 * pi * np.arange(800) / 100.0)
    x = simulate(model, u, 0.02)
    noisy = x + np.random.default_rng(1).normal(0.0, 0.05, 800)
    found = secant_gain(u[300:], noisy[300:], 100.0)
    true_gain = float(np.ptp(x[300:])) / 2.0
    assert found.gain_um_per_V == pytest.approx(true_gain, rel=2e-3)
    assert found.uncertainty_um_per_V < 2e-3 * true_gain


def test_a_record_without_gain_is_refused() -> None:
    wave = np.sin(2.0 * pi * np.arange(500) / 100.0)
    with pytest.raises(ValueError, match="voltage, peak to peak"):
        secant_gain(np.zeros(500), wave, 100.0)
    with pytest.raises(ValueError, match="product of voltage and position"):
        secant_gain(wave, -wave, 100.0)
    with pytest.raises(ValueError, match="500 voltages for 499 positions"):
        secant_gain(wave, wave[:-1], 100.0)


def test_creep_is_measured_as_a_share_of_the_step_per_decade() -> None:
    t = 0.02 * np.arange(10, 610, dtype=np.float64)
    x = 5.0 + 40.0 + 0.6 * np.log10(t / t[0])
    found = creep_after_step(t, x + np.random.default_rng(2).normal(0.0, 0.03, 600), 5.0)
    assert found.step_um == pytest.approx(40.0, abs=0.02)
    assert found.um_per_decade == pytest.approx(0.6, abs=0.02)
    assert found.percent_per_decade == pytest.approx(1.5, abs=0.05)
    assert 0.0 < found.uncertainty_percent < 0.05
    down = creep_after_step(t, 10.0 - x, 5.0)
    assert down.percent_per_decade == pytest.approx(1.5, abs=0.05)


def test_creep_that_was_not_watched_for_long_is_refused() -> None:
    t = 0.02 * np.arange(100, 400, dtype=np.float64)
    with pytest.raises(ValueError, match=r"creep over 0\.60 decades, must be at least 1"):
        creep_after_step(t, np.ones(300), 0.0)
    with pytest.raises(ValueError, match="must be positive and rise"):
        creep_after_step(t - 2.0, np.ones(300), 0.0)
    with pytest.raises(ValueError, match="step before the creep"):
        creep_after_step(0.02 * np.arange(1, 301, dtype=np.float64), np.ones(300), 1.0)
