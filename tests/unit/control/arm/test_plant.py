"""The arm's two parameter sets, and the difference equation (4) to (9)."""

import pytest

from pincette.control.arm.plant import (
    consistent_arm,
    discretize,
    perturbation,
    perturbation_bound,
    predict_position,
    printed_arm,
)

PAPER_ARM = consistent_arm(2437.8, 0.0260, 19.0, 0.46)


def test_the_consistent_parameter_set_has_units_of_mN_and_um() -> None:
    assert pytest.approx(3.658e-7, rel=1e-3) == PAPER_ARM.m
    assert pytest.approx(4.638e-5, rel=1e-3) == PAPER_ARM.b
    assert pytest.approx(2.1739, rel=1e-4) == PAPER_ARM.k
    assert pytest.approx(41.30, rel=2e-4) == PAPER_ARM.d


def test_both_parameter_sets_have_the_same_static_gain_but_different_force_gains() -> None:
    printed = printed_arm()
    assert printed.d / printed.k == pytest.approx(19.0, rel=2e-4)
    assert PAPER_ARM.d / PAPER_ARM.k == pytest.approx(19.0)
    assert 1.0 / printed.d == pytest.approx(9e-9, rel=0.02)
    assert 1.0 / PAPER_ARM.d == pytest.approx(1 / 41.3, rel=1e-3)


def test_difference_coefficients_equal_those_computed_by_hand() -> None:
    plant = discretize(printed_arm(), 0.02)
    assert plant.m_bar == pytest.approx(4.5)
    assert plant.b_bar == pytest.approx(-9.0 - 6340.0)
    assert plant.k_bar == pytest.approx(4.5 + 6340.0 + 5.943e6)
    assert plant.d_bar == 1.129e8


@pytest.mark.parametrize(("period_s", "excess"), [(0.02, 0.0015), (0.001, 0.19)])
def test_the_difference_equation_has_the_static_gain_of_the_arm(
    period_s: float, excess: float
) -> None:
    plant = discretize(PAPER_ARM, period_s)
    assert plant.m_bar + plant.b_bar + plant.k_bar == pytest.approx(PAPER_ARM.k)
    assert plant.k_bar / plant.d_bar * 19.0 - 1.0 == pytest.approx(excess, rel=0.05)


def test_the_prediction_with_the_previous_perturbation_solves_the_difference_equation() -> None:
    plant = discretize(PAPER_ARM, 0.002)
    x_3, x_2, x_1, x = 0.3, 1.1, 2.5, 4.2
    u_1, u, F_1, F = 0.11, 0.17, 1.5, 2.5
    p_1 = perturbation(plant, x_um=x_1, x_1_um=x_2, x_2_um=x_3, voltage_V=u_1, force_mN=F_1)
    p = perturbation(plant, x_um=x, x_1_um=x_1, x_2_um=x_2, voltage_V=u, force_mN=F)
    assert plant.m_bar * x_2 + plant.b_bar * x_1 + plant.k_bar * x == pytest.approx(
        plant.d_bar * u + p - F
    )
    predicted = predict_position(
        plant, voltage_step_V=u - u_1, x_1_um=x_1, x_2_um=x_2, x_3_um=x_3, force_step_mN=F - F_1
    )
    assert predicted - x == pytest.approx((p_1 - p) / plant.k_bar)


def test_perturbation_bound_is_rate_times_period() -> None:
    assert perturbation_bound(15.0, 0.02) == pytest.approx(0.3)


def test_impossible_numbers_are_refused_with_value_and_unit() -> None:
    with pytest.raises(ValueError, match=r"period = 0\.0 s, must be finite and above 0"):
        discretize(PAPER_ARM, 0.0)
    with pytest.raises(ValueError, match=r"compliance = nan µm/mN"):
        consistent_arm(2437.8, 0.026, 19.0, float("nan"))
