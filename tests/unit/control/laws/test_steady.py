"""Steady errors (51), (52) and their ranges if plan and rig may disagree."""

from math import isclose

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.control.laws.steady import steady_error_ranges, steady_state_errors

K, K_F = 1.9901e4, 5000.0
PART = {"x_e_um": 30.0, "x_e_tolerance_um": 3.0, "K_e": 2.17, "K_e_tolerance": 0.3}


@settings(derandomize=True, max_examples=30)
@given(st.floats(0.0, 30.0), st.floats(-3.0, 3.0), st.floats(0.7, 1.3), st.floats(0.0, 6000.0))
def test_the_arm_rests_where_impedance_and_contact_meet(
    force_r_mN: float, shift_um: float, factor: float, K_f: float
) -> None:
    """K·E_x + K_f·E_f = 0 and F = K_e·(x - x_e), which is what (50) leaves at rest."""
    x_r_um, x_e_um, K_e = 30.0 + force_r_mN / 2.17, 30.0 + shift_um, 2.17 * factor
    E_x, E_f = steady_state_errors(
        force_r_mN=force_r_mN, x_r_um=x_r_um, x_e_um=x_e_um, K_e=K_e, K=K, K_f=K_f
    )
    assert isclose(force_r_mN + E_f, K_e * (x_r_um + E_x - x_e_um), abs_tol=1e-9)
    assert isclose(K * E_x + K_f * E_f, 0.0, abs_tol=1e-6)
    ranges = steady_error_ranges(forces_r_mN=(0.0, 30.0), K=K, K_f=K_f, **PART)
    slack = 1e-9
    assert ranges.position_min_um - slack <= E_x <= ranges.position_max_um + slack
    assert ranges.force_min_mN - slack <= E_f <= ranges.force_max_mN + slack


def test_the_softest_and_furthest_part_gives_the_extreme_steady_errors() -> None:
    ranges = steady_error_ranges(forces_r_mN=(0.0, 20.0), K=K, K_f=K_F, **PART)
    # The softest part, 3 µm further away, at the full force.
    E_x, E_f = steady_state_errors(
        force_r_mN=20.0, x_r_um=30.0 + 20.0 / 2.17, x_e_um=33.0, K_e=2.17 * 0.7, K=K, K_f=K_F
    )
    assert (E_x, E_f) == pytest.approx((ranges.position_max_um, ranges.force_min_mN))


def test_without_tolerances_of_the_part_there_is_no_steady_error() -> None:
    ranges = steady_error_ranges(
        forces_r_mN=(2.0, 20.0),
        x_e_um=30.0,
        x_e_tolerance_um=0.0,
        K_e=2.17,
        K_e_tolerance=0.0,
        K=K,
        K_f=K_F,
    )
    found = (ranges.position_min_um, ranges.position_max_um, ranges.force_min_mN)
    assert found == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_without_force_gain_only_the_force_has_a_steady_error() -> None:
    ranges = steady_error_ranges(forces_r_mN=(0.0, 20.0), K=K, K_f=0.0, **PART)
    assert (ranges.position_min_um, ranges.position_max_um) == (0.0, 0.0)
    assert ranges.force_max_mN > 5.0


def test_impossible_tolerances_are_refused() -> None:
    with pytest.raises(ValueError, match=r"tolerance of x_e = -1\.0 µm"):
        steady_error_ranges(
            forces_r_mN=(0.0, 1.0), K=K, K_f=K_F, **(PART | {"x_e_tolerance_um": -1.0})
        )
