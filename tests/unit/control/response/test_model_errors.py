"""Errors of an identified free response: the straight line, and creep in a hold."""

import numpy as np
import pytest

from pincette.control.calibration.free_motion import secant_gain
from pincette.control.response.hysteresis_motion import Column
from pincette.control.response.model_errors import (
    line_error,
    unknown_forgetting,
)

PERIOD_S = 0.02


def test_the_line_error_of_an_ellipse_is_proportional_to_its_width() -> None:
    """x lags by a phase: about the zero at the bottom the line is wrong on both branches."""
    phase = 2.0 * np.pi * np.arange(1000) / 100.0
    errors: list[float] = []
    for lag in (0.0, 0.05, 0.1):
        loop = secant_gain(np.sin(phase), 19.0 * np.sin(phase - lag), 100.0)
        errors.append(line_error((loop,)).value)
    assert errors[0] == pytest.approx(0.0, abs=1e-9)
    assert errors[2] == pytest.approx(2.0 * errors[1], rel=0.1)
    assert errors[2] == pytest.approx(0.1 / 3.0**0.5, rel=0.1)


def small_swings(full_um: float, scale_V: float, seed: int) -> tuple[Column, Column]:
    """Return an alternating voltage of 2 V after a rest, and a residual r that decays with it,
    with noise."""
    voltage_V = np.concatenate([np.zeros(50), 0.01 * (np.arange(200) % 2)])
    way_V = np.concatenate([np.zeros(50), 0.005 * np.arange(200)])
    noise_um = np.random.default_rng(seed).normal(0.0, 0.01, 250)
    voltage_V = voltage_V.astype(np.float64)
    return voltage_V, full_um * -np.expm1(-way_V / scale_V) + noise_um


def test_the_forgotten_displacement_is_computed_from_all_swings() -> None:
    (u, up_um), (_, down_um) = small_swings(0.3, 0.2, 1), small_swings(-0.1, 0.2, 2)
    found = unknown_forgetting(
        np.concatenate([u, u]),
        np.concatenate([up_um, down_um]),
        PERIOD_S,
        (slice(50, 250), slice(300, 500)),
    )
    assert found.full_um.value == pytest.approx(((0.3**2 + 0.1**2) / 2.0) ** 0.5, rel=0.1)
    assert found.full_um.uncertainty > 0.1
    assert found.scale_V.value == 0.2
    assert found.scale_V.uncertainty > 0.0


def test_the_forgotten_displacement_of_an_actuator_without_forgetting_is_within_noise() -> None:
    u, left_um = small_swings(0.0, 0.2, 3)
    assert unknown_forgetting(u, left_um, PERIOD_S, (slice(50, 250),)).full_um.value < 0.02
    with pytest.raises(ValueError, match="small swings = 0"):
        unknown_forgetting(0.0 * u, left_um, PERIOD_S, (slice(50, 250),))
    with pytest.raises(ValueError, match="no small swings, at least one is needed"):
        unknown_forgetting(u, left_um, PERIOD_S, ())
