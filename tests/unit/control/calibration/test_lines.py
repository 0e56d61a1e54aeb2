"""Calibration by straight lines: what is recovered, how surely, and what is refused."""

from math import inf, nan

import numpy as np
import pytest

from pincette.control.calibration.lines import (
    compliance,
    contact_line,
    stiffness_line,
    straight_line,
)

S_P = 0.46


def test_a_line_without_scatter_is_exact() -> None:
    line = straight_line([1.0, 2.0, 4.0], [3.0, 5.0, 9.0])
    assert (line.slope, line.offset) == pytest.approx((2.0, 1.0))
    assert line.residuals == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert line.uncertainty_at(3.0) == pytest.approx(0.0, abs=1e-12)


def test_the_stated_uncertainties_are_those_of_many_lines() -> None:
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
    mean_at_7 = float(np.mean([line.uncertainty_at(7.0) for line in lines]))
    assert mean_at_7 == pytest.approx(float(np.std(at_7)), rel=0.1)
    assert float(np.mean(at_7)) == pytest.approx(2.5 * 7.0 - 1.0, abs=0.02)


def test_the_line_of_figure_8_plans_the_papers_pair() -> None:
    x_pp_um = [0.9, 4.0, 6.3, 8.45]
    line = stiffness_line(x_pp_um, [2.47 * x - 0.87 for x in x_pp_um])
    assert line.slope == pytest.approx(2.47)
    assert line.at(8.45) == pytest.approx(20.0, abs=0.01)


def test_one_weight_gives_the_quotient_and_the_noise_its_uncertainty() -> None:
    found = compliance([0.0, 10.0], [0.0, 4.6], noise_um=0.025)
    assert found.compliance_um_per_mN == pytest.approx(S_P)
    assert found.uncertainty_um_per_mN == pytest.approx(2**0.5 * 0.025 / 10.0)


def test_several_weights_show_their_scatter() -> None:
    found = compliance([0.0, 5.0, 10.0, 20.0], [0.02, 2.28, 4.62, 9.19])
    assert found.compliance_um_per_mN == pytest.approx(S_P, rel=0.01)
    assert len(found.residuals_um) == 4
    assert 0.0 < found.uncertainty_um_per_mN < 0.01


def test_two_points_leave_nothing_to_judge_a_line_by() -> None:
    line = straight_line([0.0, 1.0], [0.0, 2.0])
    assert line.slope_uncertainty == inf
    assert line.uncertainty_at(0.0) == inf


def press(random: np.random.Generator, count: int = 150) -> tuple[list[float], ...]:
    """A press of 8 mN on a part of 2.1 mN/µm at 31 µm, noise 30 nm; x, F, x_1."""
    K_e, x_e, noise_um = 2.1, 31.0, 0.03
    force = np.linspace(0.5, 8.0, count)
    x_true = x_e + force / K_e
    free = x_true + S_P * force
    x = x_true + random.normal(0.0, noise_um, count)
    return x.tolist(), ((free - x) / S_P).tolist(), free.tolist()


def test_the_instrument_takes_the_bias_away_that_least_squares_has() -> None:
    random = np.random.default_rng(2)
    steep, plain, contacts = list[float](), list[float](), list[float]()
    stated = list[tuple[float, float]]()
    for _ in range(300):
        # Short presses, where the noise of x is not small beside its travel.
        x, F, free = (values[:40] for values in press(random))
        plain.append(straight_line(x, F).slope)
        found = contact_line(x, F, free)
        steep.append(found.stiffness_mN_per_um)
        contacts.append(found.contact_um)
        stated.append((found.stiffness_uncertainty_mN_per_um, found.contact_uncertainty_um))
    standard_error = float(np.std(steep)) / 300**0.5
    assert float(np.mean(steep)) == pytest.approx(2.1, abs=4.0 * standard_error)
    assert float(np.mean(plain)) < 2.1 - 10.0 * standard_error
    assert float(np.mean(contacts)) == pytest.approx(31.0, abs=0.005)
    mean_stated = np.mean(stated, axis=0)
    assert mean_stated[0] == pytest.approx(float(np.std(steep)), rel=0.15)
    assert mean_stated[1] == pytest.approx(float(np.std(contacts)), rel=0.15)


def test_a_press_too_small_for_its_noise_is_refused() -> None:
    x, F, free = (values[:8] * 3 for values in press(np.random.default_rng(3)))
    with pytest.raises(ValueError, match="too small for its noise"):
        contact_line([31.0 + 0.03 * (-1) ** k for k in range(24)], F, free)
    with pytest.raises(ValueError, match="8 points of a line, must be at least 10"):
        contact_line(x[:8], F[:8], free[:8])
    with pytest.raises(ValueError, match="contact stiffness = -"):
        contact_line(free, [-force for force in F], free)


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


def test_an_arm_that_gives_way_the_wrong_way_is_refused() -> None:
    with pytest.raises(ValueError, match=r"compliance = -0\.46 µm/mN"):
        compliance([0.0, 10.0], [0.0, -4.6])
