"""The impedance filter (16), its residual (12), and its steady errors (51), (52)."""

import pytest

from pincette.control.laws.dsmifc import impedance_residual
from pincette.control.laws.impedance import (
    ImpedanceParameters,
    desired_position,
    discretize_impedance,
)
from pincette.control.laws.steady import steady_state_errors

PAPER = ImpedanceParameters(M=1e-3, B=8.9221, K=1.9901e4, K_f=5000.0)


@pytest.mark.parametrize("period_s", [0.02, 0.001])
def test_the_desired_position_satisfies_the_target_impedance(period_s: float) -> None:
    impedance = discretize_impedance(PAPER, period_s)
    x_r, d_1, d_2, F, F_r = 31.0, 0.4, -0.2, 12.0, 10.5
    x_d = desired_position(
        impedance, deviation_1_um=d_1, deviation_2_um=d_2, force_mN=F, force_r_mN=F_r, x_r_um=x_r
    )
    missed_mN = impedance_residual(
        impedance, error_um=x_d - x_r, error_1_um=d_1, error_2_um=d_2, force_error_mN=F - F_r
    )
    assert missed_mN == pytest.approx(0.0, abs=1e-8)


def test_the_impedance_yields_one_um_for_four_mN_of_excess_force() -> None:
    impedance = discretize_impedance(PAPER, 0.02)
    d_1 = d_2 = 0.0
    for _ in range(50):
        d = desired_position(
            impedance,
            deviation_1_um=d_1,
            deviation_2_um=d_2,
            force_mN=14.0,
            force_r_mN=10.0,
            x_r_um=0.0,
        )
        d_1, d_2 = d, d_1
    assert d_1 == pytest.approx(-4.0 * 5000.0 / 1.9901e4)
    assert d_1 == pytest.approx(-1.0, rel=0.01)


def test_impossible_impedance_is_refused() -> None:
    with pytest.raises(ValueError, match=r"impedance stiffness K = 0\.0 mN/µm"):
        discretize_impedance(ImpedanceParameters(1e-3, 8.9, 0.0, 5000.0), 0.02)
    with pytest.raises(ValueError, match=r"K_f = -1\.0 mN/mN, must be finite and at least 0"):
        discretize_impedance(ImpedanceParameters(1e-3, 8.9, 2e4, -1.0), 0.02)


@pytest.mark.parametrize("K_f", [0.0, 1000.0, 5000.0, 1e7])
def test_steady_errors_satisfy_impedance_and_contact(K_f: float) -> None:
    E_x, E_f = steady_state_errors(
        force_r_mN=20.0, x_r_um=40.0, x_e_um=31.0, K_e=2.47, K=1.9901e4, K_f=K_f
    )
    assert 20.0 + E_f == pytest.approx(2.47 * (40.0 + E_x - 31.0))
    assert 1.9901e4 * E_x == pytest.approx(-K_f * E_f)
