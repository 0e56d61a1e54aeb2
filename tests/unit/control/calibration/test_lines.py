"""Calibration by straight lines: recovered values, their uncertainty, and refusals."""

from math import inf, nan

import numpy as np
import pytest

from pincette.control.calibration.lines import (
    compliance,
    correlated_samples,
    stiffness_line,
    straight_line,
)

S_P = 0.46


def test_a_line_without_scatter_is_exact() -> None:
    line = straight_line([1.0, 2.0, 4.0], [3.0, 5.0, 9.0])
    assert (line.slope, line.offset) == pytest.approx((2.0, 1.0))
    assert line.residuals == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


def test_the_stated_uncertainties_equal_the_spread_of_many_lines() -> None:
    random = np.random.default_rng(1)
    x = np.linspace(2.0, 9.0, 12)
    lines = [
        straight_line(x.tolist(), (2.5 * x - 1.0 + random.normal(0.0, 0.3, 12)).tolist())
        for _ in range(400)
    ]
    for stated, values in (
        ("slope_uncertainty", [line.slope for line in lines]),
        ("offset_uncertainty", [line.offset for line in lines]),
    ):
        mean_stated = float(np.mean([getattr(line, stated) for line in lines]))
        assert mean_stated == pytest.approx(float(np.std(values)), rel=0.1)
    at_7 = [line.at(7.0) for line in lines]
    assert float(np.mean(at_7)) == pytest.approx(2.5 * 7.0 - 1.0, abs=0.02)


def test_the_line_of_figure_8_gives_the_position_and_force_of_the_paper() -> None:
    x_pp_um = [0.9, 4.0, 6.3, 8.45]
    line = stiffness_line(x_pp_um, [2.47 * x - 0.87 for x in x_pp_um])
    assert line.slope == pytest.approx(2.47)
    assert line.at(8.45) == pytest.approx(20.0, abs=0.01)


def test_one_weight_gives_the_compliance_as_a_quotient_with_the_uncertainty_from_the_noise() -> (
    None
):
    found = compliance([0.0, 10.0], [0.0, 4.6], noise_um=0.025)
    assert found.compliance_um_per_mN == pytest.approx(S_P)
    assert found.uncertainty_um_per_mN == pytest.approx(2**0.5 * 0.025 / 10.0)


def test_the_uncertainty_from_several_weights_follows_from_their_scatter() -> None:
    found = compliance([0.0, 5.0, 10.0, 20.0], [0.02, 2.28, 4.62, 9.19])
    assert found.compliance_um_per_mN == pytest.approx(S_P, rel=0.01)
    assert len(found.residuals_um) == 4
    assert 0.0 < found.uncertainty_um_per_mN < 0.01


def test_the_uncertainty_of_a_line_through_two_points_is_infinite() -> None:
    line = straight_line([0.0, 1.0], [0.0, 2.0])
    assert line.slope_uncertainty == inf


@pytest.mark.parametrize(
    ("x", "y", "text"),
    [
        ([1.0], [1.0], "1 points of a line, must be at least 2"),
        ([1.0, 2.0], [1.0], "2 values of one quantity for 1"),
        ([1.0, nan], [1.0, 2.0], "not finite"),
        ([3.0, 3.0, 3.0], [1.0, 2.0, 3.0], "all 3 points of a line have x = 3.0"),
        ([0.0, 1.0], [1.0, 0.0], "stiffness of the line = -1.0"),
    ],
)
def test_degenerate_lines_are_refused(x: list[float], y: list[float], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        stiffness_line(x, y)


def test_an_arm_that_bends_in_the_wrong_direction_is_refused() -> None:
    with pytest.raises(ValueError, match=r"compliance = -0\.46 µm/mN"):
        compliance([0.0, 10.0], [0.0, -4.6])


def test_the_spread_of_a_mean_of_correlated_errors_follows_from_their_effective_number() -> None:
    """First-order autoregression: τ = (1 + a)/(1 - a), and the variance of a mean is τ·σ²/N."""
    random, a, count = np.random.default_rng(3), 0.8, 4000
    rows: list[np.ndarray] = []
    for _ in range(200):
        row = random.normal(size=count)
        for k in range(1, count):
            row[k] += a * row[k - 1]
        rows.append(row)
    taus = [correlated_samples(row - row.mean()) for row in rows]
    assert np.mean(taus) == pytest.approx((1.0 + a) / (1.0 - a), rel=0.1)
    variance = float(np.mean([np.var(row) for row in rows]))
    scatter = float(np.std([row.mean() for row in rows]))
    assert scatter == pytest.approx((np.mean(taus) * variance / count) ** 0.5, rel=0.15)


def test_independent_errors_are_not_mistaken_for_correlated_errors() -> None:
    random = np.random.default_rng(4)
    taus = [correlated_samples(random.normal(size=500)) for _ in range(50)]
    assert float(np.median(taus)) < 1.1
    assert correlated_samples([0.0] * 5) == correlated_samples([]) == 1.0
