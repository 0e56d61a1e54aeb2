"""The sampled arm compared with a fine integration, and its state at rest."""

import numpy as np
import pytest

from pincette.control.arm.plant import consistent_arm
from pincette.control.arm.sampled_arm import LoopCase, sampled_arms
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA

D_P = 19.0
ARM = consistent_arm(OMEGA_N, ZETA, D_P, S_P)
PERIOD_S = 0.005


def integrated(case: LoopCase, lag_s: float, start: list[float], after_V: float) -> list[float]:
    """Return x, ẋ/ω_n, y after a period by Runge-Kutta, in steps that end at the change of
    voltage."""
    omega = OMEGA_N * case.frequency_factor
    square = omega * omega * (1.0 + case.K_e_mN_per_um * S_P)

    def rates(z: list[float], u: float) -> list[float]:
        y = z[2] if lag_s > 0.0 else u
        pull = omega * omega * D_P * case.gain_factor * y
        lag = (u - z[2]) / lag_s if lag_s > 0.0 else 0.0
        return [z[1], pull - square * z[0] - 2.0 * ZETA * omega * z[1], lag]

    def moved(z: list[float], rate: list[float], step_s: float) -> list[float]:
        return [a + step_s * b for a, b in zip(z, rate, strict=True)]

    z = [start[0], start[1] * OMEGA_N * case.frequency_factor, start[2]]
    delay_s = case.delay_periods * PERIOD_S
    for span_s, u in ((delay_s, start[3]), (PERIOD_S - delay_s, after_V)):
        step_s = span_s / 1000
        for _ in range(1000):
            one = rates(z, u)
            two = rates(moved(z, one, 0.5 * step_s), u)
            three = rates(moved(z, two, 0.5 * step_s), u)
            four = rates(moved(z, three, step_s), u)
            mean = [
                (a + 2.0 * b + 2.0 * c + d) / 6.0
                for a, b, c, d in zip(one, two, three, four, strict=True)
            ]
            z = moved(z, mean, step_s)
    return [z[0], z[1] / omega, z[2]]


@pytest.mark.parametrize("lag_s", [0.0, 0.0033])
@pytest.mark.parametrize(
    "case",
    [
        LoopCase(),
        LoopCase(2.17, 1.05, 0.3, 1.2),
        LoopCase(K_e_mN_per_um=1.5, delay_periods=1.0),
    ],
)
def test_one_period_is_integrated_exactly(case: LoopCase, lag_s: float) -> None:
    start = [0.7, -0.4, 0.05 if lag_s > 0.0 else 0.0, 0.03]
    transition, drive = sampled_arms(ARM, PERIOD_S, lag_s, (LoopCase(0.5), case))
    found = transition[1] @ start + drive[1] * -0.02
    assert found[:3] == pytest.approx(integrated(case, lag_s, start, -0.02), abs=1e-8)
    assert found[3] == -0.02


@pytest.mark.parametrize("lag_s", [0.0, 0.0033])
def test_at_rest_the_contact_reduces_the_displacement_of_the_arm(lag_s: float) -> None:
    case = LoopCase(K_e_mN_per_um=2.0, delay_periods=0.4, gain_factor=1.1)
    transition, drive = sampled_arms(ARM, PERIOD_S, lag_s, (case,))
    rest = np.zeros(4)
    for _ in range(200):
        rest = transition[0] @ rest + drive[0]
    assert rest[0] == pytest.approx(1.1 * D_P / (1.0 + 2.0 * S_P), rel=1e-9)
    assert rest[1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((-0.1,), "contact stiffness K_e = -0.1 mN/µm"),
        ((0.0, 0.0), "frequency factor = 0.0"),
        ((0.0, 1.0, 1.1), "delay = 1.1 periods, must be within 0 and 1"),
        ((0.0, 1.0, 0.0, 0.0), "gain factor = 0.0"),
    ],
)
def test_impossible_loop_cases_are_refused(values: tuple[float, ...], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        LoopCase(*values)
