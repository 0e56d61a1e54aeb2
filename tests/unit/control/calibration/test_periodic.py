"""Peak to peak of a periodic motion: exact, unbiased by noise, and with the stated uncertainty."""

from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray

from pincette.control.calibration.periodic import HARMONICS, periodic


def bent(count: int, per_cycle: float = 100.0) -> NDArray[np.float64]:
    """Return a cycle of three harmonics, whose peaks coincide with no peak of a single harmonic."""
    phase = 2.0 * pi * np.arange(count) / per_cycle
    return 5.0 * np.sin(phase) + 0.8 * np.sin(2.0 * phase + 0.4) + 0.4 * np.cos(3.0 * phase)


def true_peak_to_peak() -> float:
    return float(np.ptp(bent(100_000, 100_000.0)))


def test_the_amplitude_of_a_cycle_without_noise_is_exact_despite_drift() -> None:
    values = bent(437) + 12.0 + 0.004 * np.arange(437)
    found = periodic(values, 100.0)
    assert found.peak_to_peak == pytest.approx(true_peak_to_peak(), rel=1e-5)
    assert found.residual < 1e-9
    assert float(found.mean + found.cycle.max()) - found.lowest == pytest.approx(found.peak_to_peak)


def test_noise_biases_neither_the_value_nor_its_uncertainty() -> None:
    chance = np.random.default_rng(11)
    found = [periodic(0.2 * bent(400) + chance.normal(0.0, 0.2, 400), 100.0) for _ in range(400)]
    values = np.array([each.peak_to_peak for each in found])
    stated = float(np.mean([each.peak_to_peak_uncertainty for each in found]))
    error = float(np.mean(values)) - 0.2 * true_peak_to_peak()
    largest = float(np.mean([np.ptp(0.2 * bent(400) + chance.normal(0.0, 0.2, 400))]))
    print(f"error {error:.4f} of spread {np.std(values):.4f}, raw peaks err by {largest - 2.2:.2f}")
    assert abs(error) < 0.25 * float(np.std(values))
    assert stated == pytest.approx(float(np.std(values)), rel=0.2)
    assert largest > 0.2 * true_peak_to_peak() + 0.5


@pytest.mark.parametrize(
    ("count", "per_cycle", "text"),
    [
        (400, 4.0 * HARMONICS - 1.0, "35 samples per cycle, must be at least 36"),
        (150, 100.0, "1.50 cycles, must be at least 2"),
    ],
)
def test_too_few_samples_are_refused(count: int, per_cycle: float, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        periodic(bent(count), per_cycle)


def test_a_sample_that_is_invalid_is_refused() -> None:
    values = bent(400)
    values[7] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        periodic(values, 100.0)
