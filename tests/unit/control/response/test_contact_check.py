"""A residual table is validated with a pressed part whose data it was not made from."""

import numpy as np
import pytest

from pincette.control.response.contact_check import contact_scatter

NOISE_MN = 0.13
PHASE = np.linspace(0.0, 8.0 * np.pi, 400)
X_UM = 36.0 + 4.0 * np.sin(PHASE)
TRUE_MN = 12.0 + 2.1 * (X_UM - 36.0) + 0.02 * (X_UM - 36.0) ** 2
MISSED_MN = 0.4 * np.cos(PHASE)
"""Error of the free response, in mN: a loop."""


def noise_mN(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, NOISE_MN, len(PHASE))


def test_a_correct_residual_table_reduces_the_force_scatter_to_the_noise() -> None:
    found = contact_scatter(X_UM, TRUE_MN + MISSED_MN + noise_mN(1), -MISSED_MN)
    assert found is not None
    assert not found.worse
    assert found.with_mN == pytest.approx(NOISE_MN, rel=0.1)
    assert found.without_mN == pytest.approx(np.hypot(NOISE_MN, 0.4 / np.sqrt(2.0)), rel=0.1)


def test_a_table_of_another_motion_is_found() -> None:
    found = contact_scatter(X_UM, TRUE_MN + noise_mN(2), 0.3 * np.cos(PHASE))
    assert found is not None
    assert found.worse


def test_a_residual_table_that_changes_little_is_not_refused_by_chance() -> None:
    worse = 0
    for seed in range(200):
        drawn = np.random.default_rng(1000 + seed).normal(0.0, 0.1 * NOISE_MN, len(PHASE))
        found = contact_scatter(X_UM, TRUE_MN + noise_mN(seed), drawn)
        assert found is not None
        worse += found.worse
    assert worse <= 2


@pytest.mark.parametrize("count", [0, 39])
def test_with_too_few_samples_there_is_no_verdict(count: int) -> None:
    assert contact_scatter(X_UM[:count], TRUE_MN[:count], MISSED_MN[:count]) is None


def test_a_hold_without_a_change_of_force_gives_no_scatter() -> None:
    still = np.full(400, 12.0) + noise_mN(3)
    assert contact_scatter(X_UM, still, MISSED_MN) is None
