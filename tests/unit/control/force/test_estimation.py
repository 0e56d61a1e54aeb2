"""The force from inputs of equal age, the low-pass, and the uncertainty."""

from math import exp, log10, sqrt

import numpy as np
import pytest

from pincette.control.force.estimation import (
    COVERAGE,
    force,
    late_creep_um,
    smoothing,
    uncertainty,
    uncertainty_of_mean,
)

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


def test_the_uncertainty_combines_four_contributions_with_coverage_factor_two() -> None:
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


def test_an_error_known_from_few_rehearsals_is_widened_by_student_s_t() -> None:
    """Of 20 000 rigs, whose errors are estimated from four draws each, 95 % are covered."""
    rng = np.random.default_rng(9)
    for known_um in (0.0, 0.05, 0.2):
        few_um = np.sqrt(np.mean(rng.normal(0.0, 0.1, (20_000, 4)) ** 2, axis=1))
        missed_um = rng.normal(0.0, np.hypot(0.1, known_um), 20_000)
        stated_um = [
            uncertainty(
                noise_um=0.0,
                free_error_um=float(np.hypot(one_um, known_um)),
                compliance_um_per_mN=1.0,
                creep_mN_per_decade=0.0,
                zero_age_s=0.0,
                forgotten_mN=0.0,
                few_um=float(one_um),
                rehearsals=4,
            )
            for one_um in few_um
        ]
        assert np.mean(np.abs(missed_um) <= stated_um) == pytest.approx(0.95, abs=0.012)


def test_the_low_pass_follows_a_step_by_its_time_constant() -> None:
    share, force_mN = smoothing(0.02, 0.1), 0.0
    for _ in range(5):
        force_mN += share * (1.0 - force_mN)
    assert force_mN == pytest.approx(1.0 - exp(-1.0))
    assert smoothing(0.02, 0.0) == 1.0


def test_a_mean_reduces_noise_but_no_other_contribution_to_the_uncertainty() -> None:
    stated = uncertainty(
        noise_um=0.03,
        free_error_um=0.04,
        compliance_um_per_mN=0.5,
        creep_mN_per_decade=0.0,
        zero_age_s=1.0,
        forgotten_mN=0.0,
    )
    stated_mN = [stated] * 25
    mean_mN = uncertainty_of_mean(stated_mN, noise_mN=0.06, reading_mN=0.06)
    assert mean_mN == pytest.approx(COVERAGE * sqrt(0.08**2 + (0.06 / 5.0) ** 2))
    one_mN = uncertainty_of_mean(stated_mN[:1], noise_mN=0.06, reading_mN=0.06)
    assert one_mN == pytest.approx(stated)


def test_a_mean_of_filtered_readings_is_as_uncertain_as_a_mean_of_raw_readings() -> None:
    """2000 means over a hold, whose force is low-passed and has an error of 0.05 mN in addition
    to noise."""
    rng, share, count = np.random.default_rng(6), 0.5, 100
    readings = rng.normal(0.0, 0.3, (2000, count + 20))
    filtered = np.zeros_like(readings)
    for k in range(1, readings.shape[1]):
        filtered[:, k] = filtered[:, k - 1] + share * (readings[:, k] - filtered[:, k - 1])
    means_mN = filtered[:, 20:].mean(axis=1) + rng.normal(0.0, 0.05, 2000)
    noise_mN = 0.3 * sqrt(share / (2.0 - share))
    stated_mN = [COVERAGE * sqrt(noise_mN**2 + 0.05**2)] * count
    u_mN = uncertainty_of_mean(stated_mN, noise_mN=noise_mN, reading_mN=0.3)
    assert u_mN == pytest.approx(COVERAGE * float(np.std(means_mN)), rel=0.05)


def test_creep_beyond_the_known_time_widens_the_uncertainty_in_proportion_to_the_stroke() -> None:
    def late_um(age_s: float) -> float:
        return late_creep_um(percent_per_decade=1.5, stroke_um=60.0, age_s=age_s, known_to_s=125.0)

    assert late_um(125.0) == 0.0
    # 1.5 % of 60 µm in a decade, at a coverage of 2.
    assert late_um(1250.0) == pytest.approx(0.45)
    assert late_um(600.0) == pytest.approx(0.45 * log10(600.0 / 125.0))
