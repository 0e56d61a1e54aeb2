"""What the law reduces to, and how it starts, rebases, freezes and predicts."""

from dataclasses import replace
from itertools import pairwise

import pytest

from pincette.control.impedance import ImpedanceParameters, discretize_impedance
from pincette.control.pbsmic import PbsmicParameters, PbsmicState, rebase, start, step
from pincette.control.plant import consistent_arm, discretize
from pincette.control.sliding import saturation


def law(period_s: float = 0.02, K_P: float = 1.0, K_S: float = 0.0) -> PbsmicParameters:
    return PbsmicParameters(
        plant=discretize(consistent_arm(2437.8, 0.026, 19.0, 0.46), period_s),
        impedance=discretize_impedance(ImpedanceParameters(1e-3, 8.9221, 1.9901e4, 5e3), period_s),
        K_P=K_P,
        K_I=1.0,
        K_S=K_S,
        delta=2.0,
    )


def resting(x_um: float, force_mN: float) -> PbsmicState:
    """State after a hundred ticks at rest with a standing error: ε and e are far from 0."""
    state = start(x_um=x_um, x_r_um=x_um, force_mN=force_mN, applied_V=1.0)
    for _ in range(100):
        state, _ = step(
            law(),
            state,
            x_um=x_um,
            force_mN=force_mN,
            applied_V=1.0,
            x_r_um=x_um + 0.7,
            force_r_mN=force_mN,
            freeze_integral=False,
        )
    return state


@pytest.mark.parametrize("K_P", [5.0, 1.0, 0.5])
@pytest.mark.parametrize("period_s", [0.02, 0.001])
def test_low_frequency_law(period_s: float, K_P: float) -> None:
    """u_k - u_{k-1} = (k̄/d̄)[Δx_d - K_I/(K_P + K_I) e] + ΔF/d̄ - (K_S/d̄) sat(s/δ)."""
    parameters = law(period_s, K_P, K_S=0.5)
    plant = parameters.plant
    x_um, error_um = 30.0, 0.3
    state = replace(
        start(x_um=x_um, x_r_um=x_um - error_um, force_mN=4.0, applied_V=1.4),
        x_d_um=x_um - error_um,
        deviation_1_um=0.0,
        deviation_2_um=0.0,
        integral_um=0.8,
    )
    _, output = step(
        parameters,
        state,
        x_um=x_um,
        force_mN=4.6,
        applied_V=1.4,
        x_r_um=29.9,
        force_r_mN=4.6,
        freeze_integral=False,
    )
    step_um = output.x_d_um - state.x_d_um - error_um / (K_P + 1.0)
    switching_V = 0.5 / plant.d_bar * saturation(K_P * error_um + 1.1, 2.0)
    wanted_V = 1.4 + plant.k_bar / plant.d_bar * step_um + 0.6 / plant.d_bar - switching_V
    assert output.x_d_um == pytest.approx(29.9)
    assert output.voltage_V == pytest.approx(wanted_V, abs=1e-12)


@pytest.mark.parametrize("period_s", [0.02, 0.001])
def test_start_at_rest_keeps_the_voltage(period_s: float) -> None:
    state = start(x_um=12.5, x_r_um=12.5, force_mN=0.0, applied_V=0.7)
    for _ in range(5):
        state, output = step(
            law(period_s, K_S=0.5),
            state,
            x_um=12.5,
            force_mN=0.0,
            applied_V=0.7,
            x_r_um=12.5,
            force_r_mN=0.0,
            freeze_integral=False,
        )
        assert output.voltage_V == pytest.approx(0.7, abs=1e-12)
        assert output.residual_um == pytest.approx(0.0, abs=1e-12)


def test_rebase_into_contact_keeps_the_voltage() -> None:
    state = rebase(resting(30.0, 0.0), x_um=30.0, x_r_um=30.0, force_mN=2.3)
    for _ in range(3):
        state, output = step(
            law(K_S=0.5),
            state,
            x_um=30.0,
            force_mN=2.3,
            applied_V=1.0,
            x_r_um=30.0,
            force_r_mN=2.3,
            freeze_integral=False,
        )
        assert output.voltage_V == pytest.approx(1.0, abs=1e-9)


def test_without_rebase_the_force_acts_as_a_step() -> None:
    """The bump that ``rebase`` is for: its absence would go unnoticed without this."""
    _, output = step(
        law(),
        resting(30.0, 0.0),
        x_um=30.0,
        force_mN=2.3,
        applied_V=1.0,
        x_r_um=30.0,
        force_r_mN=2.3,
        freeze_integral=False,
    )
    assert abs(output.voltage_V - 1.0) > 0.02


def test_rebase_takes_up_a_distance_with_the_impedance() -> None:
    parameters = law(0.001)
    state = start(x_um=30.0, x_r_um=30.0, force_mN=0.0, applied_V=1.0)
    state = rebase(state, x_um=30.0, x_r_um=31.0, force_mN=0.0)
    desired: list[float] = []
    for _ in range(40):
        state, output = step(
            parameters,
            state,
            x_um=30.0,
            force_mN=0.0,
            applied_V=1.0,
            x_r_um=31.0,
            force_r_mN=0.0,
            freeze_integral=True,
        )
        desired.append(output.x_d_um)
    assert 30.0 < desired[0] < 30.8
    assert all(before <= after + 1e-9 for before, after in pairwise(desired))
    assert desired[-1] == pytest.approx(31.0, abs=1e-6)


def test_frozen_integral_keeps_its_value() -> None:
    state = resting(30.0, 0.0)

    def integral_after(frozen: bool) -> tuple[float, float]:
        after, output = step(
            law(),
            state,
            x_um=30.0,
            force_mN=0.0,
            applied_V=1.0,
            x_r_um=30.7,
            force_r_mN=0.0,
            freeze_integral=frozen,
        )
        return after.integral_um, output.integral_um

    assert integral_after(True) == (state.integral_um, state.integral_um)
    grown = state.integral_um - 0.7
    assert integral_after(False) == pytest.approx((grown, grown))


def test_residual_uses_the_voltage_really_applied() -> None:
    """A plant that is the model: no residual, though the actuator clips what the law asks for."""
    parameters = law()
    plant = parameters.plant
    state = start(x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0)
    x, x_1, u_1 = 0.0, 0.0, 0.0
    clipped = 0
    for tick in range(40):
        state, output = step(
            parameters,
            state,
            x_um=x,
            force_mN=0.0,
            applied_V=u_1,
            x_r_um=30.0 * min(1.0, tick / 20.0),
            force_r_mN=0.0,
            freeze_integral=False,
        )
        assert output.residual_um == pytest.approx(0.0, abs=1e-9)
        u_1 = min(output.voltage_V, 1.0)
        clipped += output.voltage_V > 1.0
        x, x_1 = (plant.d_bar * u_1 - plant.b_bar * x - plant.m_bar * x_1) / plant.k_bar, x
    assert clipped > 5
    assert x == pytest.approx(19.0)


def test_saturation() -> None:
    assert [saturation(s, 2.0) for s in (-5.0, -2.0, -1.0, 0.0, 0.5, 2.0, 9.0)] == [
        -1.0,
        -1.0,
        -0.5,
        0.0,
        0.25,
        1.0,
        1.0,
    ]
