"""Theorems 1 and 2 in discrete time: |s_k| ≤ |s_{k-1}| holds outside a band, not everywhere.

Both laws on the plant (17) with a given p̃ in every sample, F moving and known; with the identified
set d·u is k·H(u) in plant and law, and p̃ what is left of p: k times what H misses. In µm, that is
with DSMIFC's s over K̄, both (28) and (45) read s_k = s_{k-1} - a[K_S sat(s_{k-1}) + p̃_k] with
a = G_a/k̄; in mN, (45) has a = G̃_a·K̄/k̄, of which its print lost G̃_a.
"""

from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.control.arm.plant import (
    ArmParameters,
    discretize,
    predict_position,
    printed_arm,
)
from pincette.control.laws.law import Law, build, start
from pincette.control.laws.parameters import ParameterSet
from pincette.control.laws.sliding import LawOutput, saturation
from pincette.control.response import hysteresis
from pincette.control.response.hysteresis import HysteresisModel, displacement_um
from pincette.control.response.inverse import TOLERANCE_UM
from tests.support.laws import in_order, law_settings, step_at

from .model_loop import ARM, SCHEMES

K_BAR = {0.02: 1e-3 / 0.02**2 + 8.9221 / 0.02 + 1.9901e4, 0.001: 1e3 + 8922.1 + 1.9901e4}
SIGN_UM = 1e-9
"""A boundary layer so thin that sat is sgn."""
ROUNDING_UM = 1e-9
SETS: tuple[ParameterSet, ...] = ("consistent", "printed", "identified")
MODEL = HysteresisModel(
    (0.0, 0.2, 0.6), (14.0, 3.0, 2.0), (0.1, 2.0), (0.02, 0.03), (0.0, 2.0, 1.0)
)


@dataclass(frozen=True, slots=True)
class Case:
    """A law with switching gain and boundary layer given in µm of s."""

    scheme: str
    set: ParameterSet
    period_s: float
    K_P: float
    K_I: float
    a_K_S_um: float
    delta_um: float

    @property
    def arm(self) -> ArmParameters:
        return printed_arm() if self.set == "printed" else ARM

    @property
    def rounding_um(self) -> float:
        """Rounding error of s in µm: the inverse is accurate to ``TOLERANCE_UM``."""
        inverse_um = (self.K_P + self.K_I) * TOLERANCE_UM if self.set == "identified" else 0.0
        return ROUNDING_UM + inverse_um

    @property
    def a(self) -> float:
        arm, T = self.arm, self.period_s
        return (self.K_P + self.K_I) / (arm.m / T**2 + arm.b / T + arm.k)

    @property
    def K_S(self) -> float:
        return self.a_K_S_um / self.a

    def law(self) -> Law:
        delta = self.delta_um * (K_BAR[self.period_s] if self.scheme == "dsmifc" else 1.0)
        gains = in_order((self.K_P, self.K_I, self.K_S, delta))
        settings = law_settings(self.scheme, self.set, "newest", **gains)
        return build(settings, ARM, self.period_s, 0.0, MODEL)


def cases(K_S_um: st.SearchStrategy[float], delta_um: float) -> st.SearchStrategy[Case]:
    gains = st.sampled_from([(5.0, 1.0), (1.0, 1.0), (0.5, 1.0), (2.0, 3.0)])

    def make(
        scheme: str, name: ParameterSet, period_s: float, K: tuple[float, float], a_K_S_um: float
    ) -> Case:
        return Case(scheme, name, period_s, K[0], K[1], a_K_S_um, delta_um)

    return st.builds(
        make,
        st.sampled_from(SCHEMES),
        st.sampled_from(SETS),
        st.sampled_from([0.02, 0.001]),
        gains,
        K_S_um,
    )


def play(case: Case, start_um: float, errors_mN: list[float]) -> list[LawOutput]:
    """Return the values of the law; the plant is (17), displaced by ``start_um`` before the
    first tick."""
    law = case.law()
    plant = discretize(case.arm, case.period_s)
    memory = hysteresis.start(MODEL)
    state = start(law, x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0, memory=memory)
    x_1, x_2, x_3, u_1, force_1_mN = start_um, 0.0, 0.0, 0.0, 0.0
    outputs: list[LawOutput] = []
    for tick, error_mN in enumerate([*errors_mN, 0.0]):
        force_mN = 0.5 * (tick % 7)
        state, output = step_at(
            law, state, (x_1, force_mN, u_1), (0.2 * tick, 0.3 * (tick % 5)), memory=memory
        )
        outputs.append(output)
        voltage_step_V, before_um = output.voltage_V - u_1, displacement_um(MODEL, memory)
        memory = hysteresis.step(MODEL, memory, output.voltage_V, case.period_s)
        if case.set == "identified":
            voltage_step_V = (displacement_um(MODEL, memory) - before_um) * ARM.k / ARM.d
        predicted_um = predict_position(
            plant,
            voltage_step_V=voltage_step_V,
            x_1_um=x_1,
            x_2_um=x_2,
            x_3_um=x_3,
            force_step_mN=force_mN - force_1_mN,
        )
        u_1, force_1_mN = output.voltage_V, force_mN
        x_1, x_2, x_3 = predicted_um - error_mN / plant.k_bar, x_1, x_2
    return outputs


start_um = st.floats(-5.0, 5.0)
shares = st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=40)
SOME = settings(deadline=None, max_examples=30, derandomize=True)


@SOME
@given(cases(st.floats(0.01, 0.5), SIGN_UM), start_um, shares, st.floats(0.0, 2.0))
def test_with_the_sign_function_s_reaches_its_band(
    case: Case, x_um: float, shares: list[float], excess: float
) -> None:
    """``excess`` above 1 lets p̃ exceed K_S, where the theorems guarantee nothing."""
    errors_mN = [excess * case.K_S * share for share in shares]
    s = [output.sliding_um for output in play(case, x_um, errors_mN)]
    for before, after, error_mN in zip(s, s[1:], errors_mN, strict=False):
        step_um = case.a * (case.K_S * saturation(before, SIGN_UM) + error_mN)
        # (28) and (45); within rounding of 0 the sign of s is chance.
        if abs(before) > 10.0 * SIGN_UM:
            assert abs(after - (before - step_um)) < case.rounding_um
        if abs(error_mN) <= case.K_S:
            reach_um = case.a * (case.K_S + abs(error_mN))
            if abs(before) >= reach_um / 2.0:
                assert abs(after) <= abs(before) + case.rounding_um
            else:
                assert abs(after) <= reach_um + case.rounding_um


@SOME
@given(cases(st.floats(0.01, 0.5), SIGN_UM), start_um, shares)
def test_the_law_outputs_the_sliding_band_of_the_previous_step(
    case: Case, x_um: float, shares: list[float]
) -> None:
    """Sample k reports p̃; its band belongs to the step from s_{k-2} to s_{k-1}."""
    errors_mN = [case.K_S * share for share in shares]
    outputs = play(case, x_um, errors_mN)
    for before, after, error_mN in zip(outputs, outputs[1:], errors_mN, strict=False):
        assert case.a * after.perturbation_error_mN == pytest.approx(
            case.a * error_mN, abs=case.rounding_um
        )
        band_um = 0.5 * case.a * (case.K_S + abs(error_mN))
        assert after.band_um == pytest.approx(band_um, abs=case.rounding_um)
        if abs(before.sliding_um) >= after.band_um:
            assert abs(after.sliding_um) <= abs(before.sliding_um) + case.rounding_um
        else:
            assert abs(after.sliding_um) <= 2.0 * after.band_um + case.rounding_um


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_unconditional_claim_of_the_paper_fails_inside_the_band(scheme: str) -> None:
    """K_S ≥ |p̃| = 0, and yet |s| grows: (31) and (48) as printed are half of the truth."""
    case = Case(scheme, "consistent", 0.02, 1.0, 1.0, 0.5, SIGN_UM)
    first, second = (output.sliding_um for output in play(case, 0.01, [0.0]))
    assert 0.0 < abs(first) < 0.25
    assert abs(second) > 2.0 * abs(first)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_equation_45_in_mN_has_the_factor_that_is_missing_in_print(scheme: str) -> None:
    """One step beyond the layer takes G_a·K̄·K̃_S/k̄ off DSMIFC's s, not K̄·K̃_S/k̄."""
    case = Case(scheme, "consistent", 0.02, 5.0, 1.0, 0.1, SIGN_UM)
    first, second = (output.sliding_um for output in play(case, 3.0, [0.0]))
    k_bar = discretize(ARM, 0.02).k_bar
    assert first - second == pytest.approx(6.0 * case.K_S / k_bar, rel=1e-9)


@SOME
@given(cases(st.floats(0.05, 0.5), 0.5), start_um, shares)
def test_with_a_boundary_layer_s_does_not_grow_while_switching_exceeds_the_perturbation_error(
    case: Case, x_um: float, shares: list[float]
) -> None:
    """Slope a·K_S/δ ≤ 1: |s| does not grow wherever K_S |sat(s/δ)| ≥ |p̃|."""
    slope = case.a_K_S_um / case.delta_um
    errors_mN = [0.3 * case.K_S * share for share in shares]
    s = [output.sliding_um for output in play(case, x_um, errors_mN)]
    for before, after, error_mN in zip(s, s[1:], errors_mN, strict=False):
        if case.K_S * abs(saturation(before, case.delta_um)) >= abs(error_mN):
            assert abs(after) <= abs(before) + case.rounding_um
        else:
            assert abs(after) <= case.a * abs(error_mN) / slope + case.rounding_um


@pytest.mark.parametrize("scheme", SCHEMES)
def test_too_steep_a_boundary_layer_makes_the_loop_oscillate(scheme: str) -> None:
    """Slope 28, as the paper's DSMIFC gains have it with true units: s turns its sign and stays."""
    case = Case(scheme, "consistent", 0.02, 2.0, 1.0, 2.8, 0.1)
    s = [output.sliding_um for output in play(case, 0.05, [0.0] * 30)]
    assert all(after * before < 0.0 for before, after in pairwise(s[5:]))
    assert min(abs(value) for value in s[5:]) > case.delta_um
