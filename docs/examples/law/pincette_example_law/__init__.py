"""Impedance control with integral action: a control law made for this example.

The generalized impedance requests the position x_d of ``desired_position``. With the static gain g
= d/k of the arm in µm/V and the integral gain K_I (the fraction of the error removed per tick),

    u_k = u_{k-1} + [x_{d,k} - x_{d,k-1} + K_I (x_{d,k-1} - x_{k-1})]/g

The first term moves the voltage as far as x_d moves. The second term integrates the error, so that
x = x_d wherever the arm comes to rest. u_{k-1} is the voltage that was actually output, so that
there is no windup at a limit.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from pincette.control.arm.plant import DifferenceEquation
from pincette.control.laws.definition import LawDefinition
from pincette.control.laws.history import History, look
from pincette.control.laws.impedance import (
    IMPEDANCE_GAINS,
    DiscreteImpedance,
    desired_position,
    discrete_impedance_of,
    impedance_of,
)
from pincette.control.laws.parameters import LawParameter
from pincette.control.laws.sliding import LawOutput


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters of the law."""

    plant: DifferenceEquation
    impedance: DiscreteImpedance
    K_I: float


@dataclass(frozen=True, slots=True)
class State:
    """State of the law before the tick that computes u_k."""

    history: History
    x_d_um: float
    """Desired position x_{d,k-1}, in µm."""
    deviation_1_um: float
    """Deviation x_{d,k-1} - x_{r,k-1}, in µm."""
    deviation_2_um: float
    """Deviation x_{d,k-2} - x_{r,k-2}, in µm."""


def build(plant: DifferenceEquation, gains: Mapping[str, float], period_s: float) -> Parameters:
    """Discretize the impedance; raises ValueError."""
    return Parameters(plant, discrete_impedance_of(gains, period_s), gains["K_I"])


def start(
    _parameters: Parameters,
    history: History,
    *,
    x_um: float,
    x_r_um: float,
    force_error_mN: float,  # noqa: ARG001  the impedance takes it up from here
) -> State:
    """Start x_d at the position of the arm, so that a resting arm keeps its voltage."""
    return State(history, x_um, x_um - x_r_um, x_um - x_r_um)


def step(
    parameters: Parameters,
    state: State,
    *,
    x_um: float,
    force_mN: float,
    applied_V: float,
    x_r_um: float,
    force_r_mN: float,
    limited: int,  # noqa: ARG001  nothing winds up
) -> tuple[State, LawOutput]:
    """Compute the voltage u_k."""
    plant = parameters.plant
    seen = look(plant, state.history, x_um=x_um, force_mN=force_mN, applied_V=applied_V)
    x_d_um = desired_position(
        parameters.impedance,
        deviation_1_um=state.deviation_1_um,
        deviation_2_um=state.deviation_2_um,
        force_mN=force_mN,
        force_r_mN=force_r_mN,
        x_r_um=x_r_um,
    )
    error_um = x_um - state.x_d_um
    # The sum m̄ + b̄ + k̄ equals k.
    um_per_V = plant.d_bar / (plant.m_bar + plant.b_bar + plant.k_bar)
    moved_um = x_d_um - state.x_d_um - parameters.K_I * error_um
    after = State(seen.history, x_d_um, x_d_um - x_r_um, state.deviation_1_um)
    return after, LawOutput(
        voltage_V=applied_V + moved_um / um_per_V,
        x_d_um=x_d_um,
        error_um=error_um,
        integral_um=0.0,
        sliding_um=0.0,
        band_um=0.0,
        residual_um=seen.residual_um,
        perturbation_mN=seen.perturbation_mN,
        perturbation_error_mN=seen.perturbation_error_mN,
    )


LAW = LawDefinition(
    name="example_impedance",
    title="Example: impedance with integral action",
    summary="the voltage integrates the distance to the target position of the impedance",
    parameters=(
        LawParameter(
            "K_I", "", "share of the error that is removed in each sample", 0.3, positive=True
        ),
        *IMPEDANCE_GAINS,
    ),
    build=build,
    start=start,
    step=step,
    impedance=impedance_of,
    search=(("K_I", (0.1, 0.2, 0.3, 0.5)), ("K_f", (0.0, 2000.0, 5000.0))),
)
