"""The law as coded, closed over the exact sampled arm: spectral radius of the loop.

The arm is (1) with its 388 Hz mode, exact under zero-order hold. The law's matrix is read off
``step`` itself, column by column, since without switching it is linear.
"""

from dataclasses import astuple, dataclass

import numpy as np
import numpy.typing as npt
import pytest

from pincette.control.impedance import ImpedanceParameters, discretize_impedance
from pincette.control.pbsmic import PbsmicParameters, PbsmicState, step
from pincette.control.plant import ArmParameters, consistent_arm, discretize

Array = npt.NDArray[np.float64]
ARM = consistent_arm(2437.8, 0.0260, 19.0, 0.46)
CONTACT = 2.17


@dataclass(frozen=True, slots=True)
class Loop:
    """How the law is run: K_f, and whether it is fed F = K_e·x or F̂ = -(x - d_p·u)/s_p."""

    K_f: float
    estimated: bool


FRIENDLY = Loop(K_f=0.0, estimated=False)
AS_RUN = Loop(K_f=5000.0, estimated=True)


def exponential(matrix: Array) -> Array:
    """Matrix exponential by scaling and squaring of the Taylor series."""
    halvings = 20
    small = matrix / 2.0**halvings
    result = term = np.eye(matrix.shape[0])
    for order in range(1, 12):
        term = term @ small / order
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result


def held(arm: ArmParameters, K_e: float, period_s: float) -> tuple[Array, Array]:
    """Transition of (x, x') over one period and the effect of a held voltage."""
    continuous = np.zeros((3, 3))
    continuous[0, 1] = 1.0
    continuous[1] = [-(arm.k + K_e) / arm.m, -arm.b / arm.m, arm.d / arm.m]
    sampled = exponential(continuous * period_s)
    return sampled[:2, :2], sampled[:2, 2]


def spectral_radius(period_s: float, K_P: float, K_e: float, loop: Loop) -> float:
    parameters = PbsmicParameters(
        plant=discretize(ARM, period_s),
        impedance=discretize_impedance(
            ImpedanceParameters(1e-3, 8.9221, 1.9901e4, loop.K_f), period_s
        ),
        K_P=K_P,
        K_I=1.0,
        K_S=0.0,
        delta=1.0,
    )
    transition, drive = held(ARM, K_e, period_s)

    def turn(z: Array) -> Array:
        """One tick of x, x', u and of what the law keeps, ε and its prediction apart."""
        x, _, u, x_2, x_3, x_d, d_1, d_2, F_1 = (float(value) for value in z)
        after, output = step(
            parameters,
            PbsmicState(x_2, x_3, x_d, d_1, d_2, F_1, 0.0, 0.0, 0.0),
            x_um=x,
            force_mN=-(x - 19.0 * u) / 0.46 if loop.estimated else K_e * x,
            applied_V=u,
            x_r_um=0.0,
            force_r_mN=0.0,
            freeze_integral=True,
        )
        arm = transition @ z[:2] + drive * output.voltage_V
        return np.array([*arm, output.voltage_V, *astuple(after)[:2], *law_memory(after)])

    columns = [turn(unit) for unit in np.eye(9)]
    return float(np.max(np.abs(np.linalg.eigvals(np.array(columns).T))))


def law_memory(state: PbsmicState) -> tuple[float, float, float, float]:
    return state.x_d_um, state.deviation_1_um, state.deviation_2_um, state.force_mN


@pytest.mark.parametrize(
    ("period_s", "K_e", "radii"),
    [
        (0.02, 0.0, (0.84, 0.55, 0.44)),
        (0.02, CONTACT, (0.80, 0.80, 0.80)),
        (0.005, 0.0, (0.83, 0.89, 0.90)),
        (0.005, CONTACT, (0.83, 0.70, 0.77)),
        (0.004, 0.0, (0.88, 1.02, 1.33)),
        (0.001, 0.0, (1.33, 1.50, 1.58)),
        (0.001, CONTACT, (0.83, 0.85, 0.90)),
    ],
)
def test_friendliest_loop(period_s: float, K_e: float, radii: tuple[float, ...]) -> None:
    found = [spectral_radius(period_s, K_P, K_e, FRIENDLY) for K_P in (5.0, 1.0, 0.5)]
    assert found == pytest.approx(radii, abs=0.0075)


@pytest.mark.parametrize(
    ("period_s", "K_e", "radii"),
    [
        (0.02, 0.0, (0.83, 0.53, 0.58)),
        (0.02, CONTACT, (0.81, 0.67, 0.74)),
        (0.005, 0.0, (0.83, 0.92, 0.98)),
        (0.005, CONTACT, (0.88, 0.96, 1.01)),
        (0.001, 0.0, (1.60, 2.03, 2.42)),
        (0.001, CONTACT, (1.57, 1.83, 1.95)),
    ],
)
def test_loop_with_filter_and_estimated_force(
    period_s: float, K_e: float, radii: tuple[float, ...]
) -> None:
    found = [spectral_radius(period_s, K_P, K_e, AS_RUN) for K_P in (5.0, 1.0, 0.5)]
    assert found == pytest.approx(radii, abs=0.0075)
