"""The force of matched ages, the low-pass, and the uncertainty."""

from math import exp, log10, sqrt

import pytest

from pincette.control.force.estimation import force, smoothing, uncertainty

S_P = 0.46


def test_compressive_force_is_positive() -> None:
    assert force(x_um=25.4, free_um=30.0, compliance_um_per_mN=0.46) == pytest.approx(10.0)


def the_uncertainty(
    noise_um: float = 0.0,
    free_error_um: float = 0.0,
    zero_age_s: float = 0.0,
    forgotten_mN: float = 0.0,
) -> float:
    return uncertainty(
        noise_um=noise_um,
        free_error_um=free_error_um,
        compliance_um_per_mN=S_P,
        creep_mN_per_decade=0.3,
        zero_age_s=zero_age_s,
        forgotten_mN=forgotten_mN,
    )


def test_uncertainty_has_four_parts_and_coverage_two() -> None:
    noise, free, age = (
        the_uncertainty(noise_um=0.03),
        the_uncertainty(free_error_um=0.1),
        the_uncertainty(zero_age_s=99.0),
    )
    assert noise == pytest.approx(2.0 * 0.03 / 0.46)
    assert free == pytest.approx(2.0 * 0.1 / 0.46)
    assert age == pytest.approx(2.0 * 0.3 * log10(100.0))
    whole = sqrt(noise**2 + free**2 + age**2 + (2.0 * 0.7) ** 2)
    assert the_uncertainty(0.03, 0.1, 99.0, 0.7) == pytest.approx(whole)


def test_the_low_pass_follows_a_step_by_its_time_constant() -> None:
    share, force_mN = smoothing(0.02, 0.1), 0.0
    for _ in range(5):
        force_mN += share * (1.0 - force_mN)
    assert force_mN == pytest.approx(1.0 - exp(-1.0))
    assert smoothing(0.02, 0.0) == 1.0
