"""What DSMIFC reduces to, in numbers and at low frequency, and what ζ does."""

from itertools import pairwise

import pytest
from msgspec.structs import replace

from pincette.control.arm.plant import discretize
from pincette.control.laws.dsmifc import DsmifcState, start, step
from pincette.control.laws.history import rest
from pincette.control.laws.impedance import ImpedanceParameters, discretize_impedance
from pincette.control.laws.sliding import LawOutput, SlidingParameters, saturation
from tests.support.laws import law_settings

from .model_loop import ARM, Loop, law_of, resting_arm

K = 1.9901e4


def law(
    period_s: float = 0.02, K_P: float = 1.0, K_S: float = 0.0, K_f: float = 5e3
) -> SlidingParameters:
    return SlidingParameters(
        plant=discretize(ARM, period_s),
        impedance=discretize_impedance(ImpedanceParameters(1e-3, 8.9221, K, K_f), period_s),
        K_P=K_P,
        K_I=1.0,
        K_S=K_S,
        delta=4e4,
    )


def resting(x_r_um: float, force_mN: float, force_r_mN: float) -> DsmifcState:
    """At rest at 30 µm and 1.4 V."""
    history = rest(x_um=30.0, force_mN=force_mN, applied_V=1.4)
    error_mN = force_mN - force_r_mN
    return start(law(K_P=1.0), history, x_um=30.0, x_r_um=x_r_um, force_error_mN=error_mN)


def test_one_tick_in_numbers() -> None:
    """T = 0.02 s, K̃_P = 2, K̃_I = 1, no switching: by hand from (5), (13), (33), (34), (42)."""
    _, output = step(
        law(K_P=2.0),
        resting(30.0, 2.0, 1.9),
        x_um=30.12,
        force_mN=2.5,
        applied_V=1.61,
        x_r_um=30.2,
        force_r_mN=2.1,
        limited=0,
    )
    # K̄ = 2.5 + 446.105 + 19901; ε = K̄·0.12 + 5000·0.1 mN, with ẽ = 0 before.
    epsilon = (20349.605 * 0.12 + 500.0) / 20349.605
    assert output.error_um == pytest.approx(epsilon, abs=1e-12)
    assert output.sliding_um == pytest.approx(3.0 * epsilon, abs=1e-12)
    # 30.2 - [B̄·0.12 + 5000·0.4]/K̄ with B̄ = -5 - 446.105 and ẽ_{k-2} = 0.
    x_d_um = 30.2 - (-451.105 * 0.12 + 2000.0) / 20349.605
    assert output.x_d_um == pytest.approx(x_d_um, abs=1e-12)
    # m̄ 30 + (b̄ - m̄)30 + (k̄ - b̄)30.12 - 0.5 with m̄ = 9.14505e-4, b̄ = -4.147565e-3, k̄ = 2.1771461
    coasting_mN = 2.1771461 * 30.12 + 4.147565e-3 * 0.12 - 0.5
    wanted_V = 1.61 + (2.1771461 * (x_d_um + 2.0 / 3.0 * epsilon) - coasting_mN) / 41.304348
    assert output.voltage_V == pytest.approx(wanted_V, abs=2e-7)


@pytest.mark.parametrize("K_P", [5.0, 1.0, 0.5])
@pytest.mark.parametrize("period_s", [0.02, 0.001])
def test_low_frequency_law(period_s: float, K_P: float) -> None:
    """With f = F - F_r, the arm at rest, and Δ the change from k-1 to k:

    Δu = (k̄/d̄)[Δx_r - K_f/K̄ Δf - K_I/(K_P + K_I) ε/K̄] + ΔF/d̄ - (K_S/d̄) sat(s/δ), ε = K ẽ + K_f f.
    """
    parameters = law(period_s, K_P, K_S=0.5)
    plant, K_bar = parameters.plant, parameters.impedance.K_bar
    state = replace(resting(29.7, 4.0, 3.8), integral_mN=9e3)
    _, output = step(
        parameters,
        state,
        x_um=30.0,
        force_mN=4.6,
        applied_V=1.4,
        x_r_um=29.9,
        force_r_mN=4.3,
        limited=0,
    )
    epsilon = K * 0.3 + 5e3 * 0.2
    step_um = 0.2 - 5e3 / K_bar * 0.1 - epsilon / K_bar / (K_P + 1.0)
    sat = saturation(K_P * epsilon + 9e3 + epsilon, 4e4)
    step_V = plant.k_bar / plant.d_bar * step_um + (0.6 - 0.5 * sat) / plant.d_bar
    assert output.error_um == pytest.approx(epsilon / K_bar, abs=1e-12)
    assert output.voltage_V == pytest.approx(1.4 + step_V, abs=1e-12)


@pytest.mark.parametrize("K_S", [0.0, 0.5])
def test_without_impedance_and_force_it_is_pbsmic(K_S: float) -> None:
    """M = B = K_f = 0: x_d = x_r and ε = K̄ e, so that with δ̃ = K̄ δ both laws are one."""
    pbsmic = law_settings("pbsmic", K_P=2.0, K_S=K_S, delta=0.4, M=0.0, B=0.0, K_f=0.0)
    gains = {**pbsmic.gains, "delta": 0.4 * K}
    dsmifc = law_settings("dsmifc", "consistent", "planned", **gains)
    runs: list[list[LawOutput]] = []
    for settings in (pbsmic, dsmifc):
        loop = Loop(law_of(settings), resting_arm(10.0, K_e=2.0, x_e_um=8.0))
        ramp = [(10.0 + 0.1 * min(tick, 20), 4.0) for tick in range(60)]
        runs.append(loop.follow(ramp))
    for one, other in zip(*runs, strict=True):
        assert one.voltage_V == pytest.approx(other.voltage_V, abs=1e-12)
        assert one.sliding_um == pytest.approx(other.sliding_um, abs=1e-11)


def test_an_error_left_at_the_start_keeps_its_share_from_step_to_step() -> None:
    """ẽ = -1 µm as the segment begins: ε_k = K̃_P/(K̃_P + K̃_I) ε_{k-1}."""
    loop = Loop(law_of(law_settings("dsmifc", K_P=2.0)), resting_arm(30.0))
    loop.x_r_um = 31.0
    loop.change(loop.law)
    errors = [loop.tick(31.0).error_um for _ in range(12)]
    assert errors[0] == pytest.approx(-K / loop.law.parameters.impedance.K_bar)
    for before, after in pairwise(errors):
        assert after == pytest.approx(before * 2.0 / 3.0, rel=1e-9)


def one_step(parameters: SlidingParameters, integral_mN: float, limited: int) -> LawOutput:
    """At rest with ẽ = -0.7 µm: below its target, the arm asks for more voltage."""
    _, output = step(
        parameters,
        replace(resting(30.7, 0.0, 0.0), integral_mN=integral_mN),
        x_um=30.0,
        force_mN=0.0,
        applied_V=1.4,
        x_r_um=30.7,
        force_r_mN=0.0,
        limited=limited,
    )
    return output


@pytest.mark.parametrize(("limited", "grown_um"), [(1, 0.0), (0, -0.7), (-1, -0.7)])
def test_integral_is_frozen_outward_only(limited: int, grown_um: float) -> None:
    K_bar = law().impedance.K_bar
    output = one_step(law(), -6e4, limited)
    assert output.integral_um == pytest.approx((-6e4 + grown_um * K) / K_bar, abs=1e-12)


def test_integral_moves_the_voltage_through_the_switching_term_alone() -> None:
    assert one_step(law(), 0.0, 0).voltage_V == one_step(law(), 1e6, 0).voltage_V
    low, high = (one_step(law(K_S=0.5), ζ, 0).voltage_V for ζ in (-1e6, 1e6))
    assert low - high == pytest.approx(2.0 * 0.5 / ARM.d, rel=1e-9)
