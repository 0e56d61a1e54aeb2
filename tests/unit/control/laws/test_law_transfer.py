"""A change of law or the start of a segment causes no jump in the voltage."""

from math import sin

import pytest

from pincette.control.laws.law import rebase, start
from tests.support.laws import law_settings, step_at

from .model_loop import SCHEMES, Loop, law_of, resting_arm

BOTH = pytest.mark.parametrize("scheme", SCHEMES)
PERIODS = pytest.mark.parametrize("period_s", [0.02, 0.001])
K_E, X_E_UM = 2.17, 20.0
ORDER: tuple[str, ...] = ("pbsmic", "dsmifc", "pbsmic")


@BOTH
@PERIODS
def test_a_rebase_in_contact_keeps_the_voltage(scheme: str, period_s: float) -> None:
    """The law received no force while it pressed with 2.3 mN; from here on it does."""
    law = law_of(law_settings(scheme, K_S=0.5, delta=0.5), period_s)
    state = start(law, x_um=30.0, x_r_um=30.7, force_mN=0.0, applied_V=1.0)

    def tick(force_mN: float, x_r_um: float) -> float:
        nonlocal state
        state, output = step_at(law, state, (30.0, force_mN, 1.0), (x_r_um, force_mN))
        return output.voltage_V

    # A hundred ticks with a standing error: ε and e are far from 0.
    for _ in range(100):
        tick(0.0, 30.7)
    kept = state
    assert abs(tick(2.3, 30.0) - 1.0) > 0.02
    state = rebase(law, kept, x_um=30.0, x_r_um=30.0, force_mN=2.3, force_r_mN=2.3)
    for _ in range(5):
        assert tick(2.3, 30.0) == pytest.approx(1.0, abs=1e-12)


@BOTH
def test_a_rebase_keeps_measured_and_applied_values(scheme: str) -> None:
    """The residual right after it still belongs to the samples before."""
    law = law_of(law_settings(scheme), 0.001)
    loop = Loop(law, resting_arm(5.0, 0.001))
    for tick in range(20):
        loop.tick(5.0 + 0.05 * tick)
    history = loop.state.law.history
    other = law_of(law_settings("dsmifc" if scheme == "pbsmic" else "pbsmic"), 0.001)
    loop.change(other)
    after = loop.state.law.history
    assert (after.x_2_um, after.x_3_um) == (history.x_2_um, history.x_3_um)
    assert (after.applied_V, after.coasting_um) == (history.applied_V, history.coasting_um)
    assert loop.tick(6.0).residual_um == pytest.approx(0.0, abs=1e-9)


def voltages(period_s: float, K_e: float, d_share: float, *, change: bool) -> list[float]:
    """Return the voltages along a moving plan that fits the part.

    The law is PBSMIC throughout, or becomes DSMIFC and PBSMIC again, after 25 ticks each. The arm's
    d is ``d_share`` of what the laws know.
    """
    laws = [law_of(law_settings(scheme, K_P=2.0), period_s, 0.03) for scheme in ORDER]
    loop = Loop(laws[0], resting_arm(25.0, period_s, K_e=K_e, x_e_um=X_E_UM))
    plant = loop.arm.plant
    loop.arm.plant = type(plant)(plant.m_bar, plant.b_bar, plant.k_bar, d_share * plant.d_bar)
    loop.arm.voltage_V /= d_share
    loop = Loop(laws[0], loop.arm)
    found: list[float] = []
    for tick in range(1, 76):
        if change and tick in (26, 51):
            loop.change(laws[tick // 25])
        x_r_um = 25.0 + 4.0 * sin(0.04 * tick)
        found.append(loop.tick(x_r_um, K_e * (x_r_um - X_E_UM)).voltage_V)
    return found


def steps(of: list[float]) -> list[float]:
    return [of[tick] - of[tick - 1] for tick in (25, 50)]


@PERIODS
@pytest.mark.parametrize("K_e", [0.0, K_E])
def test_a_change_of_law_during_motion_does_not_change_the_voltages_if_the_model_is_exact(
    period_s: float, K_e: float
) -> None:
    changed, unchanged = (voltages(period_s, K_e, 1.0, change=change) for change in (True, False))
    assert changed == pytest.approx(unchanged, abs=1e-9)
    assert min(abs(step_V) for step_V in steps(unchanged)) > 2e-3


@PERIODS
@pytest.mark.parametrize("K_e", [0.0, K_E])
@pytest.mark.parametrize("d_share", [0.85, 1.15])
def test_a_change_of_law_during_motion_changes_the_voltage_by_less_than_a_step_of_the_plan(
    period_s: float, K_e: float, d_share: float
) -> None:
    """The arm's d_p is 15 % off, so that there is an error when the law changes."""
    changed, unchanged = (
        steps(voltages(period_s, K_e, d_share, change=change)) for change in (True, False)
    )
    for ours, plans in zip(changed, unchanged, strict=True):
        assert abs(ours - plans) < abs(plans)


@BOTH
def test_a_change_of_law_at_the_steady_errors_of_an_inconsistent_plan_moves_nothing(
    scheme: str,
) -> None:
    """E_x and E_f of (51), (52) remain, and no other law changes them."""
    other = law_of(law_settings("dsmifc" if scheme == "pbsmic" else "pbsmic", K_P=3.0))
    loop = Loop(law_of(law_settings(scheme)), resting_arm(25.0, K_e=K_E, x_e_um=X_E_UM))
    for _ in range(300):
        loop.tick(26.0, 9.0)
    before_V, error_um = loop.arm.voltage_V, loop.arm.x_um - 26.0
    assert abs(error_um) > 0.3
    loop.change(other)
    for _ in range(20):
        assert loop.tick(26.0, 9.0).voltage_V == pytest.approx(before_V, abs=1e-9)
