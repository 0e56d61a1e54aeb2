"""Noise of a sensor: white part under drift, quantisation, and the reliability of its
uncertainty."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pincette.control.calibration.noise import sensor_noise

PERIOD_S = 0.02
COUNT = 400


def readings(seed: int, sigma_um: float, step_um: float = 1e-5) -> NDArray[np.float64]:
    """Return white noise on a drift and a slow swing, as displayed."""
    chance = np.random.default_rng(seed)
    t = PERIOD_S * np.arange(COUNT)
    x = 12.3456 + 0.02 * t + 0.03 * np.sin(2.0 * np.pi * t / 6.0)
    return np.round((x + chance.normal(0.0, sigma_um, COUNT)) / step_um) * step_um


def test_white_noise_is_separated_from_drift_and_oscillation() -> None:
    found = [sensor_noise(readings(seed, 0.03), PERIOD_S, 0.03) for seed in range(200)]
    values = np.array([each.noise_um for each in found])
    stated = float(np.mean([each.noise_uncertainty_um for each in found]))
    assert float(np.mean(values)) == pytest.approx(0.03, rel=0.01)
    assert stated == pytest.approx(float(np.std(values)), rel=0.15)
    assert all(each.spread_um > each.noise_um for each in found[:20])
    assert found[0].drift_um_per_s == pytest.approx(0.02, abs=0.01)
    assert found[0].resolution_um == pytest.approx(6.6 * found[0].noise_um)
    assert not found[0].quantised


def test_the_low_pass_of_the_law_averages_white_noise() -> None:
    chance = np.random.default_rng(3)
    found = sensor_noise(chance.normal(0.0, 0.03, 20_000), PERIOD_S, 0.03)
    share = 1.0 - np.exp(-PERIOD_S / 0.03)
    assert found.filtered_noise_um == pytest.approx(0.03 * (share / (2.0 - share)) ** 0.5, rel=0.03)
    plain = sensor_noise(chance.normal(0.0, 0.03, 20_000), PERIOD_S)
    assert plain.filtered_noise_um == pytest.approx(0.03, rel=0.02)


def test_a_quantization_step_wider_than_the_noise_is_the_resolution() -> None:
    fine = readings(4, 0.002) - 0.02 * PERIOD_S * np.arange(COUNT)
    found = sensor_noise(np.round(fine / 0.1) * 0.1, PERIOD_S, 0.03)
    assert found.step_um == pytest.approx(0.1)
    assert found.quantised
    assert found.resolution_um == pytest.approx(0.1)
    assert found.filtered_resolution_um >= 0.1


def test_the_noise_includes_the_quantization_by_a_fine_step() -> None:
    chance = np.random.default_rng(5)
    x = np.round(chance.normal(0.0, 0.03, 20_000) / 0.05) * 0.05
    found = sensor_noise(x, PERIOD_S)
    assert found.step_um == pytest.approx(0.05)
    assert found.noise_um == pytest.approx((0.03**2 + 0.05**2 / 12.0) ** 0.5, rel=0.02)


@pytest.mark.parametrize(
    ("x_um", "text"),
    [
        ([1.0] * 99, "99 readings of the noise, must be at least 100"),
        ([1.0] * 400, "all 400 readings are 1 µm"),
        ([float("nan")] * 400, "not finite"),
    ],
)
def test_uninformative_readings_are_refused(x_um: list[float], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        sensor_noise(x_um, PERIOD_S)
