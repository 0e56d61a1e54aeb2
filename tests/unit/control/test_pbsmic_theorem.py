"""Theorem 1 in discrete time: |s_k| ≤ |s_{k-1}| holds outside a band, not everywhere.

From (28), with a = (K_P + K_I)/k̄: s_k = s_{k-1} - a[K_S sat(s_{k-1}) + p̃_k]. With K_S ≥ |p̃| the
sliding function never grows outside the band |s| ≥ a(K_S + |p̃|)/2, and inside it may jump over
zero, yet stays within a(K_S + |p̃|).
"""

from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.control.impedance import ImpedanceParameters, discretize_impedance
from pincette.control.pbsmic import PbsmicParameters, start, step
from pincette.control.plant import consistent_arm, discretize, predict_position
from pincette.control.sliding import saturation

PERIOD_S = 0.02
PLANT = discretize(consistent_arm(2437.8, 0.026, 19.0, 0.46), PERIOD_S)
IMPEDANCE = discretize_impedance(ImpedanceParameters(1e-3, 8.9221, 1.9901e4, 5e3), PERIOD_S)
SIGN = 1e-9
"""A boundary layer so thin that sat is sgn."""
ROUNDING_UM = 1e-9


def sliding(parameters: PbsmicParameters, start_um: float, errors_mN: list[float]) -> list[float]:
    """s_0, s_1, … of the law on the plant (17) with a given p̃ in every sample."""
    state = start(x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0)
    # x_{k-1}, x_{k-2}, x_{k-3}; the arm is pushed off its desired position before the first tick.
    x_1, x_2, x_3, u_1 = start_um, 0.0, 0.0, 0.0
    found: list[float] = []
    for tick, error_mN in enumerate([*errors_mN, 0.0]):
        state, output = step(
            parameters,
            state,
            x_um=x_1,
            force_mN=0.0,
            applied_V=u_1,
            x_r_um=0.2 * tick,
            force_r_mN=0.0,
            freeze_integral=False,
        )
        found.append(output.sliding_um)
        predicted_um = predict_position(
            PLANT,
            voltage_step_V=output.voltage_V - u_1,
            x_1_um=x_1,
            x_2_um=x_2,
            x_3_um=x_3,
            force_step_mN=0.0,
        )
        u_1 = output.voltage_V
        x_1, x_2, x_3 = predicted_um - error_mN / PLANT.k_bar, x_1, x_2
    return found


gains = st.sampled_from([(5.0, 1.0), (1.0, 1.0), (0.5, 1.0), (2.0, 3.0)])
start_um = st.floats(-5.0, 5.0)
shares = st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=40)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(gains, start_um, shares, st.floats(0.01, 0.5), st.floats(0.0, 2.0))
def test_sliding_function_with_sgn(
    K: tuple[float, float], x_um: float, shares: list[float], K_S: float, excess: float
) -> None:
    """``excess`` above 1 lets p̃ exceed K_S, where the theorem promises nothing."""
    errors_mN = [excess * K_S * share for share in shares]
    s = sliding(PbsmicParameters(PLANT, IMPEDANCE, *K, K_S, SIGN), x_um, errors_mN)
    a = (K[0] + K[1]) / PLANT.k_bar
    for before, after, error_mN in zip(s, s[1:], errors_mN, strict=False):
        step_um = a * (K_S * saturation(before, SIGN) + error_mN)
        assert abs(after - (before - step_um)) < ROUNDING_UM
        toward_zero_um = step_um if before >= 0.0 else -step_um
        if abs(before) > SIGN and 0.0 <= toward_zero_um <= 2.0 * abs(before):
            assert abs(after) <= abs(before) + ROUNDING_UM
        if abs(error_mN) <= K_S:
            band_um = a * (K_S + abs(error_mN))
            if abs(before) >= band_um / 2.0:
                assert abs(after) <= abs(before) + ROUNDING_UM
            else:
                assert abs(after) <= band_um + ROUNDING_UM


def test_unconditional_claim_fails_inside_the_band() -> None:
    """K_S ≥ |p̃| = 0, and yet |s| grows: (31) as printed is half of the truth."""
    s = sliding(PbsmicParameters(PLANT, IMPEDANCE, 1.0, 1.0, 0.5, SIGN), 0.01, [0.0])
    assert abs(s[1]) > 10.0 * abs(s[0])


@settings(deadline=None, max_examples=60, derandomize=True)
@given(gains, start_um, shares, st.floats(0.1, 1.0))
def test_sliding_function_with_boundary_layer(
    K: tuple[float, float], x_um: float, shares: list[float], slope: float
) -> None:
    """Slope a·K_S/δ ≤ 1: |s| does not grow wherever K_S |sat(s/δ)| ≥ |p̃|."""
    a = (K[0] + K[1]) / PLANT.k_bar
    delta = 0.5
    K_S = slope * delta / a
    errors_mN = [0.3 * K_S * share for share in shares]
    s = sliding(PbsmicParameters(PLANT, IMPEDANCE, *K, K_S, delta), x_um, errors_mN)
    for before, after, error_mN in zip(s, s[1:], errors_mN, strict=False):
        if K_S * abs(saturation(before, delta)) >= abs(error_mN):
            assert abs(after) <= abs(before) + ROUNDING_UM
        else:
            assert abs(after) <= a * abs(error_mN) / slope + ROUNDING_UM
