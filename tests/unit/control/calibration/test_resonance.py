"""Swept sine to the model (54): known parameters are recovered from noisy records."""

from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray

from pincette.control.calibration.frequency_response import swept_response
from pincette.control.calibration.resonance import fit_second_order

OMEGA_N, ZETA, D_P = 2437.8, 0.026, 19.0
RATE_HZ = 5000.0


def gain(f: NDArray[np.float64]) -> NDArray[np.complex128]:
    s = 2j * pi * f
    return D_P * OMEGA_N**2 / (s * s + 2 * ZETA * OMEGA_N * s + OMEGA_N**2)


def answer(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mode's exact response to voltages held between samples, from rest."""
    dt, sigma = 1.0 / RATE_HZ, ZETA * OMEGA_N
    damped = (OMEGA_N**2 - sigma**2) ** 0.5
    c, s = np.exp(-sigma * dt) * np.cos(damped * dt), np.exp(-sigma * dt) * np.sin(damped * dt)
    s /= damped
    x = v = 0.0
    out = np.empty(len(u))
    for index, level in enumerate((D_P * u).tolist()):
        out[index] = x
        e = x - level
        x, v = level + (c + sigma * s) * e + s * v, -(OMEGA_N**2) * s * e + (c - sigma * s) * v
    return out


def test_exact_magnitudes_reproduce_the_parameters() -> None:
    f = np.linspace(20.0, 800.0, 60)
    found = fit_second_order(f, np.abs(gain(f)), to_hz=800.0)
    assert found.natural_frequency_rad_per_s == pytest.approx(OMEGA_N, rel=1e-9)
    assert found.damping_ratio == pytest.approx(ZETA, rel=1e-8)
    assert found.gain_um_per_V == pytest.approx(D_P, rel=1e-9)


def test_the_stated_uncertainties_are_those_of_many_fits() -> None:
    random = np.random.default_rng(4)
    f = np.linspace(20.0, 600.0, 117)
    fits = [
        fit_second_order(f, gain(f) * np.exp(random.normal(0.0, 0.05, len(f))), to_hz=600.0)
        for _ in range(100)
    ]
    for value, stated, true in (
        ("natural_frequency_rad_per_s", "natural_frequency_uncertainty_rad_per_s", OMEGA_N),
        ("damping_ratio", "damping_ratio_uncertainty", ZETA),
        ("gain_um_per_V", "gain_uncertainty_um_per_V", D_P),
    ):
        values = [getattr(fit, value) for fit in fits]
        mean_stated = float(np.mean([getattr(fit, stated) for fit in fits]))
        assert float(np.mean(values)) == pytest.approx(true, rel=0.01)
        assert mean_stated == pytest.approx(float(np.std(values)), rel=0.3)


def test_a_recorded_sweep_gives_the_mode() -> None:
    t = np.arange(0.0, 10.0, 1.0 / RATE_HZ)
    swept = t <= 9.0
    phase = 2 * pi * (20.0 * t + 0.5 * (600.0 - 20.0) / 9.0 * t * t)
    u = np.where(swept, 0.1 * np.sin(phase), 0.0)
    x = answer(u) + np.random.default_rng(5).normal(0.0, 0.03, len(t)) + 12.0
    response = swept_response(u.tolist(), x.tolist(), RATE_HZ, from_hz=25.0, to_hz=590.0)
    found = fit_second_order(
        response.frequency_hz,
        response.gain_um_per_V,
        to_hz=590.0,
        log_gain_uncertainty=response.log_gain_uncertainty,
    )
    assert found.natural_frequency_rad_per_s == pytest.approx(OMEGA_N, rel=0.005)
    assert found.damping_ratio == pytest.approx(ZETA, rel=0.1)
    assert found.gain_um_per_V == pytest.approx(D_P, rel=0.02)


@pytest.mark.parametrize(
    ("f_hz", "to_hz", "text"),
    [
        (np.linspace(20.0, 800.0, 9), 800.0, "9 points up to 800.0 Hz, must be at least 10"),
        (np.linspace(20.0, 800.0, 60), 200.0, "no resonance up to 200.0 Hz"),
        (np.linspace(20.0, 388.0, 60), 388.0, "no resonance up to 388.0 Hz"),
        (np.linspace(-20.0, 800.0, 60), 800.0, "not finite and above 0"),
    ],
)
def test_responses_without_a_resonance_are_refused(
    f_hz: NDArray[np.float64], to_hz: float, text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        fit_second_order(f_hz, gain(f_hz), to_hz=to_hz)


@pytest.mark.parametrize(
    ("count", "from_hz", "to_hz", "text"),
    [
        (40, 25.0, 500.0, "0 bands of 200 were driven"),
        (5000, 25.0, 2600.0, "must ascend from above 0 Hz to 2500.0 Hz"),
    ],
)
def test_an_uninformative_sweep_is_refused(
    count: int, from_hz: float, to_hz: float, text: str
) -> None:
    u = np.sin(np.arange(count) * 0.3).tolist()
    with pytest.raises(ValueError, match=text):
        swept_response(u, u, RATE_HZ, from_hz=from_hz, to_hz=to_hz)
