"""The fit of the contact line."""

import numpy as np
import pytest

from pincette.control.contact_line import ContactLine


def line(points: list[tuple[float, float]]) -> ContactLine:
    result = ContactLine()
    for x_um, force_mN in points:
        result = result.add(x_um, force_mN)
    return result


def test_exact_line() -> None:
    fit = line([(30.0 + 0.1 * i, 2.17 * (0.1 * i + 0.8)) for i in range(40)]).fit()
    assert fit is not None
    assert fit.K_e_mN_per_um == pytest.approx(2.17)
    assert fit.x_e_um == pytest.approx(29.2)


def test_agrees_with_least_squares_far_from_the_origin() -> None:
    draw = np.random.default_rng(3)
    x = 1e7 + np.linspace(0.0, 8.0, 100)
    F = 2.3 * (x - 1e7) + 5.0 + draw.normal(0.0, 0.2, 100)
    fit = line([(float(a), float(b)) for a, b in zip(x, F, strict=True)]).fit()
    slope, offset = (float(value) for value in np.polyfit(x - 1e7, F, 1))
    assert fit is not None
    assert fit.K_e_mN_per_um == pytest.approx(slope, rel=1e-8)
    assert fit.x_e_um - 1e7 == pytest.approx(-offset / slope, rel=1e-6)


def test_no_fit_without_spread_points_or_slope() -> None:
    assert ContactLine().fit() is None
    assert line([(0.0, 0.0), (5.0, 10.0)]).fit() is None
    assert line([(30.0 + 0.01 * (i % 2), 5.0 + i) for i in range(50)]).fit() is None
    assert line([(1.0 * i, 5.0) for i in range(9)]).fit() is None
    assert line([(7.0, 5.0)] * 9).fit(minimum_spread_um=0.0) is None
    assert line([(0.1 * i, 0.2 * i) for i in range(9)]).fit(minimum_spread_um=0.2) is not None


def test_adding_leaves_the_line_before_as_it_was() -> None:
    before = line([(0.0, 0.0), (1.0, 2.0), (2.0, 4.0)])
    before.add(3.0, 100.0)
    fit = before.fit()
    assert fit is not None
    assert fit == pytest.approx((0.0, 2.0))
