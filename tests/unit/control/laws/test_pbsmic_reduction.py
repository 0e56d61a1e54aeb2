"""What PBSMIC reduces to, in numbers and at low frequency, and what ε does."""

from itertools import pairwise

import pytest
from msgspec.structs import replace

from pincette.control.arm.plant import discretize
from pincette.control.laws.history import rest
from pincette.control.laws.impedance import ImpedanceParameters, discretize_impedance
from pincette.control.laws.pbsmic import PbsmicState, start, step
from pincette.control.laws.sliding import LawOutput, SlidingParameters, saturation

from .model_loop import ARM


def law(
    period_s: float = 0.02, K_P: float = 1.0, K_S: float = 0.0, K_f: float = 5e3
) -> SlidingParameters:
    return SlidingParameters(
        plant=discretize(ARM, period_s),
        impedance=discretize_impedance(ImpedanceParameters(1e-3, 8.9221, 1.9901e4, K_f), period_s),
        K_P=K_P,
        K_I=1.0,
        K_S=K_S,
        delta=2.0,
    )


def resting(x_um: float, x_r_um: float, force_mN: float, applied_V: float) -> PbsmicState:
    history = rest(x_um=x_um, force_mN=force_mN, applied_V=applied_V)
    return start(law(K_P=1.0), history, x_um=x_um, x_r_um=x_r_um, force_error_mN=0.0)


def test_one_tick_in_numbers() -> None:
    """T = 0.02 s, K_P = 5, K_I = 1, no switching: computed by hand from (5), (13), (16), (25)."""
    _, output = step(
        law(K_P=5.0),
        resting(30.0, 30.0, 2.0, 1.6),
        x_um=30.12,
        force_mN=2.5,
        applied_V=1.61,
        x_r_um=30.2,
        force_r_mN=2.1,
        limited=0,
    )
    assert output.error_um == pytest.approx(0.12)
    assert output.sliding_um == pytest.approx(0.72)
    # 30.2 - 5000·0.4/20349.605
    assert output.x_d_um == pytest.approx(30.2 - 2000.0 / 20349.605, abs=1e-9)
    # u = 1.61 + [k̄(x_d + 0.1) - (m̄ 30 + (b̄ - m̄)30 + (k̄ - b̄)30.12) + 0.5]/41.304348
    # with m̄ = 9.14505e-4, b̄ = -4.147565e-3, k̄ = 2.1771461
    assert output.voltage_V == pytest.approx(1.6264005568, abs=1e-9)
    # 0.12 - (41.304348/2.1771466)·0.01
    assert output.residual_um == pytest.approx(0.12 - 0.1897178, abs=1e-6)


@pytest.mark.parametrize("K_P", [5.0, 1.0, 0.5])
@pytest.mark.parametrize("period_s", [0.02, 0.001])
def test_low_frequency_law(period_s: float, K_P: float) -> None:
    """u_k - u_{k-1} = (k̄/d̄)[Δx_d - K_I/(K_P + K_I) e] + ΔF/d̄ - (K_S/d̄) sat(s/δ)."""
    parameters = law(period_s, K_P, K_S=0.5)
    plant = parameters.plant
    x_um, error_um = 30.0, 0.3
    state = replace(
        resting(x_um, x_um - error_um, 4.0, 1.4),
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
        limited=0,
    )
    step_um = output.x_d_um - state.x_d_um - error_um / (K_P + 1.0)
    switching_V = 0.5 / plant.d_bar * saturation(K_P * error_um + 1.1, 2.0)
    wanted_V = 1.4 + plant.k_bar / plant.d_bar * step_um + 0.6 / plant.d_bar - switching_V
    assert output.x_d_um == pytest.approx(29.9)
    assert output.voltage_V == pytest.approx(wanted_V, abs=1e-12)


def test_without_K_f_the_force_error_moves_nothing() -> None:
    """K_f = 0: x_d is x_r, and F enters as ΔF/d̄ alone."""
    parameters = law(K_f=0.0)
    voltages: list[float] = []
    for force_r_mN in (0.0, 40.0):
        state, output = step(
            parameters,
            resting(30.0, 30.0, 7.0, 1.4),
            x_um=30.0,
            force_mN=7.0,
            applied_V=1.4,
            x_r_um=30.4,
            force_r_mN=force_r_mN,
            limited=0,
        )
        assert state.x_d_um == pytest.approx(30.4, abs=1e-12)
        voltages.append(output.voltage_V)
    assert voltages[0] == voltages[1]


def test_start_takes_up_a_distance_with_the_impedance() -> None:
    parameters = law(0.001)
    state = resting(30.0, 31.0, 0.0, 1.0)
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
            limited=0,
        )
        desired.append(output.x_d_um)
    assert 30.0 < desired[0] < 30.8
    assert all(before <= after + 1e-9 for before, after in pairwise(desired))
    assert desired[-1] == pytest.approx(31.0, abs=1e-6)


def one_step(parameters: SlidingParameters, integral_um: float, limited: int) -> LawOutput:
    """At rest with e = -0.7 µm: below its target, the arm asks for more voltage."""
    state = replace(resting(30.0, 30.7, 0.0, 1.0), x_d_um=30.7, integral_um=integral_um)
    _, output = step(
        parameters,
        state,
        x_um=30.0,
        force_mN=0.0,
        applied_V=1.0,
        x_r_um=30.7,
        force_r_mN=0.0,
        limited=limited,
    )
    return output


@pytest.mark.parametrize(("limited", "grown_um"), [(1, 0.0), (0, -0.7), (-1, -0.7)])
def test_integral_is_frozen_outward_only(limited: int, grown_um: float) -> None:
    assert one_step(law(), -3.0, limited).integral_um == pytest.approx(-3.0 + grown_um, abs=1e-12)


def test_integral_moves_the_voltage_through_the_switching_term_alone() -> None:
    assert one_step(law(), 0.0, 0).voltage_V == one_step(law(), 50.0, 0).voltage_V
    low, high = (one_step(law(K_S=0.5), ε, 0).voltage_V for ε in (-50.0, 50.0))
    assert low - high == pytest.approx(2.0 * 0.5 / ARM.d, rel=1e-9)
