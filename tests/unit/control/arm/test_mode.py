"""The sampled mode compared with the matrix exponential, and the composition of its steps."""

import pytest

from pincette.control.arm.mode import Mode, sample_mode
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA, transition

PERIODS = pytest.mark.parametrize("period_s", [0.0005, 0.001, 0.00258, 0.02])


def through(mode: Mode, offset_um: float, speed_um_per_s: float) -> tuple[float, float]:
    return (
        mode.xx * offset_um + mode.xv * speed_um_per_s,
        mode.vx * offset_um + mode.vv * speed_um_per_s,
    )


@PERIODS
def test_the_transition_is_the_matrix_exponential(period_s: float) -> None:
    mode = sample_mode(OMEGA_N, ZETA, period_s)
    exact = transition(period_s, omega_n=OMEGA_N, zeta=ZETA, K_e=0.0)
    assert mode.xx == pytest.approx(exact[0, 0], abs=1e-9)
    assert mode.xv == pytest.approx(exact[0, 1], abs=1e-12)
    assert mode.vx == pytest.approx(exact[1, 0], abs=1e-6)
    assert mode.vv == pytest.approx(exact[1, 1], abs=1e-9)
    # A force that rises by 1 mN over the period moves the equilibrium by -s_p.
    assert -S_P * mode.ramp_x == pytest.approx(exact[0, 3] / period_s, abs=1e-9)
    assert -S_P * mode.ramp_v == pytest.approx(exact[1, 3] / period_s, abs=1e-5)


@PERIODS
def test_two_half_steps_equal_a_whole_step(period_s: float) -> None:
    half, whole = sample_mode(OMEGA_N, ZETA, period_s / 2), sample_mode(OMEGA_N, ZETA, period_s)
    wanted = through(whole, 1.3, -200.0)
    assert through(half, *through(half, 1.3, -200.0)) == pytest.approx(wanted, rel=1e-9)


def test_over_a_period_of_the_mode_only_damping_remains() -> None:
    damped_s = 2.0 * 3.141592653589793 / (OMEGA_N * (1.0 - ZETA**2) ** 0.5)
    mode = sample_mode(OMEGA_N, ZETA, damped_s)
    assert mode.xx == pytest.approx(2.718281828459045 ** (-ZETA * OMEGA_N * damped_s))
    assert mode.xv == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("omega_n", "zeta", "period_s", "text"),
    [
        (0.0, ZETA, 0.02, "natural frequency = 0.0 rad/s"),
        (OMEGA_N, 0.0, 0.02, "damping ratio = 0.0"),
        (OMEGA_N, 1.0, 0.02, "damping ratio = 1.0, must be below 1"),
        (OMEGA_N, ZETA, -0.02, "period = -0.02 s"),
    ],
)
def test_an_impossible_mode_is_refused(
    omega_n: float, zeta: float, period_s: float, text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        sample_mode(omega_n, zeta, period_s)
