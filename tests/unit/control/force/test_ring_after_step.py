"""The ring of the pressed mode after a slip, and none after a jump of the sensor."""

from math import sqrt

import numpy as np
import pytest

from pincette.control.force.ring_after_step import RESTED, ring_samples, rings

MODE_RAD_PER_S, DECAY_PER_S = 2440.0, 63.0
KAPPA = 1.0
PERIODS_S = (0.02, 0.001)


def share_that_rings(step_um: float, noise_um: float, period_s: float, *, slip: bool) -> float:
    """Return the share of 400 steps that ring; frequencies are known to 1 %, the time of a step
    is random."""
    rng = np.random.default_rng(46)
    pressed = MODE_RAD_PER_S * sqrt(1.0 + KAPPA)
    count = ring_samples(DECAY_PER_S, period_s) + RESTED
    found = 0
    for _ in range(400):
        true = pressed * (1.0 + 0.01 * rng.standard_normal())
        t_s = (np.arange(count) + rng.uniform()) * period_s
        ring_um = -step_um * np.exp(-DECAY_PER_S * t_s) * np.cos(true * t_s) if slip else 0.0
        x_um = 40.0 + step_um + ring_um + noise_um * rng.standard_normal(count)
        found += bool(
            rings(
                x_um,
                mode_rad_per_s=pressed,
                decay_per_s=DECAY_PER_S,
                period_s=period_s,
                noise_um=noise_um,
            )
        )
    return found / 400


@pytest.mark.parametrize(
    ("period_s", "step_um", "noise_um", "least"),
    [
        (0.02, 1.0, 0.03, 0.85),
        (0.02, 2.0, 0.03, 0.95),
        (0.02, 2.0, 0.15, 0.3),
        (0.001, 0.5, 0.03, 0.9),
        (0.001, 2.0, 0.15, 0.9),
    ],
)
def test_ringing_after_a_slip_is_detected(
    period_s: float, step_um: float, noise_um: float, least: float
) -> None:
    assert share_that_rings(step_um, noise_um, period_s, slip=True) > least


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize("noise_um", [0.03, 0.15])
def test_a_jump_of_the_sensor_does_not_ring(period_s: float, noise_um: float) -> None:
    assert share_that_rings(2.0, noise_um, period_s, slip=False) <= 0.01


def test_too_few_samples_give_no_verdict() -> None:
    assert (
        rings(
            np.zeros(5),
            mode_rad_per_s=MODE_RAD_PER_S,
            decay_per_s=DECAY_PER_S,
            period_s=0.02,
            noise_um=0.03,
        )
        is None
    )
