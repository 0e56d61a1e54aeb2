"""The fit of the contact line, with the planned force as the instrument."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pincette.control.planning.contact_line import ContactFit, ContactLine
from pincette.control.planning.profiles import quintic

K_E, X_E, COMPLIANCE = 2.17, 30.0, 0.46
PLAN = np.array([2.0 + 18.0 * quintic(k / 100.0) for k in range(101)])
Column = NDArray[np.float64]


def line(x_um: Column, force_mN: Column, force_r_mN: Column) -> ContactLine:
    result = ContactLine()
    for sample in zip(x_um.tolist(), force_mN.tolist(), force_r_mN.tolist(), strict=True):
        result = result.add(*sample)
    return result


def fitted(x_um: Column, force_mN: Column, force_r_mN: Column = PLAN) -> ContactFit:
    fit = line(x_um, force_mN, force_r_mN).fit()
    assert fit is not None
    return fit


def test_an_exact_line_is_fitted_exactly() -> None:
    fit = fitted(X_E + PLAN / K_E, PLAN)
    assert fit.K_e_mN_per_um == pytest.approx(K_E)
    assert fit.x_e_um == pytest.approx(X_E)
    assert fit.K_e_error_mN_per_um == pytest.approx(0.0, abs=1e-6)


def test_a_plan_for_another_stiffness_also_works() -> None:
    x_um = 29.0 + PLAN / 2.6
    assert fitted(x_um, K_E * (x_um - X_E)).K_e_mN_per_um == pytest.approx(K_E)


def test_a_line_far_from_the_origin_is_fitted_without_loss_of_digits() -> None:
    fit = fitted(1e7 + PLAN / K_E, PLAN)
    assert fit.K_e_mN_per_um == pytest.approx(K_E, rel=1e-7)
    assert fit.x_e_um - 1e7 == pytest.approx(0.0, abs=1e-6)


def test_noise_common_to_position_and_force_does_not_bias_the_stiffness() -> None:
    """F̂ = (x_1 - x)/s_p has the noise of x; over a short load, least squares is biased by it."""
    draw = np.random.default_rng(4)
    plan, noise_um = 10.0 + 0.1 * (PLAN - 10.0), 0.3
    stiffnesses: list[float] = []
    slopes: list[float] = []
    for _ in range(400):
        noise = draw.normal(0.0, noise_um, len(plan))
        x_um, force_mN = X_E + plan / K_E + noise, plan - noise / COMPLIANCE
        stiffnesses.append(fitted(x_um, force_mN, plan).K_e_mN_per_um)
        slopes.append(float(np.polyfit(x_um, force_mN, 1)[0]))
    spread = float(np.std(stiffnesses)) / 400.0**0.5
    assert float(np.mean(slopes)) < 0.5 * K_E
    assert float(np.median(stiffnesses)) == pytest.approx(K_E, abs=4.0 * spread)


def test_standard_errors_equal_the_spread_of_repeated_fits() -> None:
    draw = np.random.default_rng(5)
    fits: list[ContactFit] = []
    for _ in range(300):
        noise = draw.normal(0.0, 0.05, len(PLAN))
        fits.append(fitted(X_E + PLAN / K_E + noise, PLAN - noise / COMPLIANCE))
    stated = float(np.mean([fit.K_e_error_mN_per_um for fit in fits]))
    assert float(np.std([fit.K_e_mN_per_um for fit in fits])) == pytest.approx(stated, rel=0.15)
    stated = float(np.mean([fit.x_e_error_um for fit in fits]))
    assert float(np.std([fit.x_e_um for fit in fits])) == pytest.approx(stated, rel=0.3)
    # A load from 2 to 20 mN in 2 s at the paper's noise knows K_e to 1 %, by the noise alone.
    assert fits[0].K_e_error_mN_per_um < 0.01 * K_E


def test_a_lagging_force_causes_no_bias_over_a_forward_and_backward_motion() -> None:
    there_and_back = np.concatenate([PLAN, PLAN[::-1]])
    x_um = X_E + there_and_back / K_E
    lagging = np.concatenate([there_and_back[:1], there_and_back[:-1]])
    fit = fitted(x_um, lagging, there_and_back)
    assert fit.x_e_um == pytest.approx(X_E, abs=1e-2)
    assert fit.K_e_mN_per_um == pytest.approx(K_E, rel=2e-3)
    one_way = fitted(x_um[:101], lagging[:101])
    assert one_way.x_e_um > X_E + 0.05


def test_too_few_points_or_too_little_spread_or_slope_give_no_fit() -> None:
    ramp = np.arange(9.0)
    assert ContactLine().fit() is None
    assert line(ramp[:2], ramp[:2], ramp[:2]).fit() is None
    assert line(30.0 + 0.01 * ramp, ramp, ramp).fit() is None
    assert line(ramp, np.full(9, 5.0), ramp).fit() is None
    assert line(ramp, ramp, np.full(9, 5.0)).fit() is None
    assert line(0.1 * ramp, 0.2 * ramp, ramp).fit(minimum_spread_um=0.2) is not None


def test_adding_a_point_returns_a_new_line_and_leaves_the_earlier_one_unchanged() -> None:
    before = line(np.arange(3.0), 2.0 * np.arange(3.0), np.arange(3.0))
    before.add(3.0, 100.0, 3.0)
    fit = before.fit()
    assert fit is not None
    assert fit[:2] == pytest.approx((0.0, 2.0))
