"""Both laws against a spring F = K_e·(x - x_e): rest positions, motion, and remaining errors."""

from math import pi, sin

import pytest

from pincette.control.arm.plant import printed_arm
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.parameters import ForceAge, ParameterSet
from pincette.control.laws.steady import steady_state_errors
from tests.support.laws import law_settings

from .model_loop import ARM, SCHEMES, Loop, law_of, resting_arm

BOTH = pytest.mark.parametrize("scheme", SCHEMES)
K, K_E, X_E_UM, T = 1.9901e4, 2.17, 20.0, 0.02


def in_contact(settings: LawSettings, x_um: float = 25.0, filter_s: float = 0.0) -> Loop:
    return Loop(law_of(settings, T, filter_s), resting_arm(x_um, T, K_e=K_E, x_e_um=X_E_UM))


@BOTH
@pytest.mark.parametrize("set_", ["consistent", "printed"])
@pytest.mark.parametrize("age", ["planned", "newest"])
@pytest.mark.parametrize("K_f", [0.0, 1000.0, 2000.0, 3000.0, 4000.0, 5000.0, 6000.0])
def test_the_steady_state_satisfies_equations_51_and_52(
    scheme: str, set_: ParameterSet, age: ForceAge, K_f: float
) -> None:
    """A plan that deviates by 1 µm and 4 mN from the part, as in Fig. 7(d), and one that fits
    it."""
    loop = in_contact(law_settings(scheme, set_, K_f=K_f, force_age=age), filter_s=0.03)
    for x_r_um, force_r_mN in ((27.0, K_E * (26.0 - X_E_UM) - 4.0), (27.0, K_E * 7.0)):
        error_um = [loop.tick(x_r_um, force_r_mN).error_um for _ in range(400)]
        E_x, E_f = loop.arm.x_um - x_r_um, loop.arm.force_mN - force_r_mN
        mismatch_mN = force_r_mN + K_E * (X_E_UM - x_r_um)
        if K_f:
            assert E_x == pytest.approx(mismatch_mN / (K_E + K / K_f), abs=1e-9)
            assert E_f == pytest.approx(-(K / K_f) * E_x, abs=1e-8)
        else:
            assert pytest.approx((0.0, -mismatch_mN), abs=1e-9) == (E_x, E_f)
        stated = steady_state_errors(
            force_r_mN=force_r_mN, x_r_um=x_r_um, x_e_um=X_E_UM, K_e=K_E, K=K, K_f=K_f
        )
        assert stated == pytest.approx((E_x, E_f), abs=1e-8)
        assert error_um[-1] == pytest.approx(0.0, abs=1e-9)
    assert pytest.approx((0.0, 0.0), abs=1e-8) == (E_x, E_f)


def track(loop: Loop, settled: int = 0) -> tuple[float, float]:
    """Return the largest position and force error over a plan that fits the part: 8.45 µm, 0.5
    Hz."""
    worst_um = worst_mN = 0.0
    for tick in range(1, 251):
        x_r_um = 25.0 + 4.225 * sin(pi * T * tick)
        loop.tick(x_r_um, K_E * (x_r_um - X_E_UM))
        if tick > settled:
            worst_um = max(worst_um, abs(loop.arm.x_um - x_r_um))
            worst_mN = max(worst_mN, abs(loop.arm.force_mN - loop.force_r_mN))
    return worst_um, worst_mN


@BOTH
@pytest.mark.parametrize("filter_s", [0.0, 0.03])
def test_with_the_planned_force_a_consistent_moving_plan_has_no_error(
    scheme: str, filter_s: float
) -> None:
    worst = track(in_contact(law_settings(scheme), filter_s=filter_s))
    assert worst == pytest.approx((0.0, 0.0), abs=1e-9)


@BOTH
@pytest.mark.parametrize("K_f", [2000.0, 5000.0])
def test_with_the_newest_force_the_error_on_a_ramp_is_as_calculated(
    scheme: str, K_f: float
) -> None:
    """F̂ is one period old, so that the law sees K_e·v·T too little: E = K_f K_e v T/(K + K_f K_e)
    ahead of the plan, where (14), or ε = 0, holds with that force."""
    loop = in_contact(law_settings(scheme, K_f=K_f, force_age="newest"))
    for tick in range(1, 301):
        x_r_um = 25.0 + 0.1 * tick
        loop.tick(x_r_um, K_E * (x_r_um - X_E_UM))
    ahead_um = K_f * K_E * 0.1 / (K + K_f * K_E)
    assert loop.arm.x_um - loop.x_r_um == pytest.approx(ahead_um, rel=1e-6)
    assert ahead_um > 0.01


@BOTH
def test_the_planned_force_removes_the_known_error(scheme: str) -> None:
    """The paper's sinusoid: at K_f = 5000 the age alone costs a third of v·T at its steepest."""
    worst_um, worst_mN = track(in_contact(law_settings(scheme, force_age="newest")), settled=50)
    steepest_um = 4.225 * pi * T
    assert worst_um == pytest.approx(5e3 * K_E / (K + 5e3 * K_E) * steepest_um, rel=0.05)
    assert worst_mN == pytest.approx(K_E * worst_um, rel=0.01)


@BOTH
def test_without_the_force_term_the_arm_moves_only_half_of_a_step_in_contact(scheme: str) -> None:
    """With the printed set's d̄, ΔF/d̄ is almost 0: the incremental gain is 1/(1 + s_p K_e) of d_p.

    With the true set, which takes ΔF into account, the arm moves the whole step.
    """
    gains: dict[str, float] = {}
    for set_ in ("consistent", "printed"):
        name: ParameterSet = "printed" if set_ == "printed" else "consistent"
        loop = in_contact(law_settings(scheme, name, K_P=1.0))
        loop.tick(25.0, K_E * 5.0)
        loop.tick(26.0, K_E * 6.0)
        gains[set_] = loop.arm.x_um - 25.0
    known = printed_arm()
    k_bar, d_bar = known.k + known.b / T + known.m / T**2, known.d
    plant = loop.arm.plant
    assert gains["consistent"] == pytest.approx(1.0, abs=1e-9)
    assert gains["printed"] == pytest.approx(
        k_bar / d_bar * plant.d_bar / (plant.k_bar + K_E), rel=1e-6
    )
    assert gains["printed"] == pytest.approx(1.0 / (1.0 + 0.46 * K_E), rel=0.005)


@BOTH
def test_the_printed_set_lags_behind_a_moving_plan_in_contact(scheme: str) -> None:
    printed = track(in_contact(law_settings(scheme, "printed", force_age="planned")))[0]
    assert printed > 0.05


@BOTH
def test_the_low_pass_reduces_noise_of_the_voltage(scheme: str) -> None:
    """F̂ alternates by 0.3 mN: the share limits how much of it reaches the voltage."""
    swings: list[float] = []
    for filter_s in (0.0, 0.1):
        loop = in_contact(law_settings(scheme), filter_s=filter_s)
        noise = (0.3, -0.3)
        found = [
            loop.tick(25.0, K_E * 5.0, noise_mN=noise[tick % 2]).voltage_V for tick in range(200)
        ]
        swings.append(max(found[100:]) - min(found[100:]))
    assert swings[1] < 0.3 * swings[0]
    assert swings[0] > 0.001


def test_both_parameter_sets_agree_on_positions() -> None:
    """k/d of the printed set is 1/19.0 V/µm as the rig's: only forces are lost in it."""
    known = printed_arm()
    assert known.d / known.k == pytest.approx(ARM.d / ARM.k, rel=2e-4)
