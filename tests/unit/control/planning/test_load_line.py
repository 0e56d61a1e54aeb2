"""The contact line that the references of a load follow: never softer than the samples allow."""

from math import inf

import numpy as np
import pytest
from msgspec.structs import replace

from pincette.control.planning.contact_line import ContactLine
from pincette.control.planning.load_line import (
    line_share,
    stiffest_line,
    stiffness_bounds,
    stiffness_error,
)
from pincette.control.planning.program import Guards

S_P, HARDEST = 0.46, 6.6
GUARDS = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.9, 1.0)


def loaded(K_e: float, noise_um: float, count: int, seed: int = 0) -> ContactLine:
    """Return samples of a load from 2 mN to 20 mN, with noise in x and in F̂ = (x_1 - x)/s_p."""
    rng, line = np.random.default_rng(seed), ContactLine()
    for force_mN in np.linspace(2.0, 20.0, count):
        error_um = noise_um * rng.standard_normal()
        line = line.add(30.0 + force_mN / K_e + error_um, force_mN - error_um / S_P, force_mN)
    return line


def test_the_line_through_one_sample_has_the_stiffness_of_the_stiffest_part() -> None:
    line = ContactLine().add(31.0, 2.2, 2.2)
    found = stiffest_line(line, HARDEST, 0.03, S_P)
    assert found.K_e_mN_per_um == HARDEST
    assert found.x_e_um == pytest.approx(31.0 - 2.2 / HARDEST)


@pytest.mark.parametrize("K_e", [0.7, 1.1, 2.2, 4.4, 6.6])
def test_without_noise_the_fitted_line_is_used(K_e: float) -> None:
    found = stiffest_line(loaded(K_e, 0.0, 10), HARDEST, 0.0, S_P)
    assert found.K_e_mN_per_um == pytest.approx(K_e)
    assert found.x_e_um == pytest.approx(30.0)


@pytest.mark.parametrize("noise_um", [0.03, 0.05, 0.15])
@pytest.mark.parametrize("count", [5, 15, 100])
def test_the_assumed_line_is_rarely_softer_than_the_part_and_approaches_its_stiffness(
    noise_um: float, count: int
) -> None:
    K_e = 2.2
    found = [
        stiffest_line(loaded(K_e, noise_um, count, seed), HARDEST, noise_um, S_P).K_e_mN_per_um
        for seed in range(100)
    ]
    assert np.mean(np.array(found) < K_e) <= 0.08
    line = loaded(K_e, noise_um, count)
    fit = line.fit()
    assert fit is not None
    wide = stiffness_error(line, fit, noise_um, S_P)
    assert np.median(found) <= min(HARDEST, K_e * (1.0 + 4.0 * wide))


def test_a_contact_line_fitted_across_a_slip_is_not_used() -> None:
    line = ContactLine()
    for number, force_mN in enumerate((2.0, 5.0, 8.0, 11.0, 9.0, 12.0, 15.0)):
        slip_um = 3.0 if number >= 4 else 0.0
        line = line.add(30.0 + slip_um + force_mN / 2.2, force_mN, 2.0 + 3.0 * number)
    assert stiffest_line(line, HARDEST, 0.03, S_P).K_e_mN_per_um == HARDEST


def test_the_bounds_of_usable_stiffnesses_are_correct() -> None:
    assert stiffness_bounds(2.2, GUARDS) == pytest.approx((0.66, 6.6))
    # A program that searches for the stiffness has wider guards.
    assert stiffness_bounds(0.5, GUARDS) == pytest.approx((0.15, 2.9))


def test_the_contact_line_changes_with_the_same_time_constant_at_every_period() -> None:
    assert line_share(0.02) == pytest.approx(1.0 - (1.0 - line_share(0.001)) ** 20)


def test_guards_without_an_upper_bound_still_limit_the_stiffness() -> None:
    guards = replace(GUARDS, stiffness_min_mN_per_um=0.0, stiffness_max_mN_per_um=inf)
    assert stiffness_bounds(2.0, guards) == (0.0, 6.0)
