"""The kink at the end of a slow approach."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pincette.control.calibration.first_touch import NoTouchError, first_touch

S_P, K_E, X_E = 0.46, 2.1, 31.2


def approach(
    noise_um: float, zero_mN: float = 0.0, seed: int = 1, to_um: float = 40.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions and estimated forces as the free response goes from 25 µm on; the zero
    may have an error."""
    chance = np.random.default_rng(seed)
    free = np.arange(25.0, to_um, 0.08)
    depth = np.maximum(0.0, free - X_E) / (1.0 + S_P * K_E)
    x = np.minimum(free, X_E) + depth + chance.normal(0.0, noise_um, len(free))
    return x, (free - x) / S_P + zero_mN


def test_an_approach_without_noise_is_exact_whatever_the_zero_error() -> None:
    for zero_mN in (0.0, -0.7):
        found = first_touch(*approach(0.0, zero_mN), S_P)
        assert found.contact_um == pytest.approx(X_E, abs=1e-6)
        assert found.stiffness_mN_per_um == pytest.approx(K_E, rel=1e-6)


def test_the_stated_uncertainty_equals_the_spread_of_many_approaches() -> None:
    found = [first_touch(*approach(0.05, seed=seed), S_P) for seed in range(200)]
    values = [each.contact_um for each in found]
    stated = float(np.mean([each.uncertainty_um for each in found]))
    assert float(np.mean(values)) == pytest.approx(X_E, abs=4.0 * float(np.std(values)) / 200**0.5)
    assert stated == pytest.approx(float(np.std(values)), rel=0.2)
    surely = first_touch(*approach(0.05), S_P, 0.1)
    assert surely.uncertainty_um == pytest.approx(np.hypot(stated, 0.1), rel=0.05)


def test_the_uncertainty_includes_correlated_errors() -> None:
    """A free response that wanders by 0.03 µm over some ten samples, like those of real rigs."""
    random = np.random.default_rng(7)
    errors_um: list[float] = []
    stated_um: list[float] = []
    for seed in range(100):
        x, force_mN = approach(0.03, seed=seed)
        wander_um = np.convolve(random.normal(size=len(x) + 9), np.ones(10) / 10**0.5, "valid")
        found = first_touch(x, force_mN + 0.03 * wander_um / S_P, S_P)
        errors_um.append(found.contact_um - X_E)
        stated_um.append(found.uncertainty_um)
    within = np.abs(errors_um) <= 2.0 * np.array(stated_um)
    assert 0.85 <= float(np.mean(within)) <= 0.99
    assert float(np.median(2.0 * np.array(stated_um) / np.abs(errors_um))) < 4.0


def test_a_noisy_touch_is_found_if_the_press_is_longer() -> None:
    with pytest.raises(NoTouchError):
        first_touch(*approach(0.6, to_um=33.5), S_P)
    found = first_touch(*approach(0.6, to_um=50.0), S_P)
    assert found.contact_um == pytest.approx(X_E, abs=3.0 * found.uncertainty_um)


def test_an_approach_without_contact_is_refused() -> None:
    with pytest.raises(NoTouchError, match="no significant touch within the approach"):
        first_touch(*approach(0.05, to_um=30.0), S_P)
    x, force = approach(0.05)
    with pytest.raises(ValueError, match="29 samples of an approach, must be at least 30"):
        first_touch(x[:29], force[:29], S_P)
    with pytest.raises(ValueError, match="must be equal in number"):
        first_touch(x, force[1:], S_P)
    x[3] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        first_touch(x, force, S_P)
