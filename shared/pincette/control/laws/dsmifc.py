"""Discrete-time sliding mode impedance force control (DSMIFC), (33) to (45).

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. Forces are compressive: F > 0 is
the force of the grip on the object. Where (39) and (44) print K_I, K̃_I is meant.
"""

from dataclasses import dataclass

from pincette.control.arm.plant import DifferenceEquation
from pincette.control.laws.history import History, look
from pincette.control.laws.impedance import DiscreteImpedance, desired_position, impedance_residual
from pincette.control.laws.sliding import LawOutput, saturation, sliding_band, winds_up


@dataclass(frozen=True, slots=True)
class DsmifcParameters:
    """The law's model of the arm, its target impedance and its gains."""

    plant: DifferenceEquation
    impedance: DiscreteImpedance
    K_P: float
    K_I: float
    """K̃_P and K̃_I without unit; K̃_P ≥ 0, K̃_I > 0. Where the model holds, each sample takes
    the share K̃_I/(K̃_P + K̃_I) off the impedance measure error."""
    K_S: float
    """Switching gain K̃_S in mN; 0 switches it off. The slope (K̃_P + K̃_I)·K̄·K̃_S/(k̄·δ̃) inside
    the boundary layer belongs between 0 and 1."""
    delta: float
    """Half width δ̃ of the boundary layer in mN."""


@dataclass(frozen=True, slots=True)
class DsmifcState:
    """What the law remembers, named as it stands before the tick that computes u_k."""

    history: History
    x_r_um: float
    """x_{r,k-1}."""
    error_2_um: float
    """ẽ_{k-2} = x_{k-2} - x_{r,k-2}."""
    error_3_um: float
    """ẽ_{k-3}."""
    force_error_mN: float
    """F_{k-1} - F_{r,k-1}, as the last tick used them."""
    integral_mN: float
    """ζ_{k-2}."""


def start(
    history: History, *, x_um: float, x_r_um: float, force_mN: float, force_r_mN: float
) -> DsmifcState:
    """Begin a segment without a bump, just before the step that gets the same ``x_um``.

    ζ = 0, and the arm counts as having rested where it is. The step that follows keeps the voltage
    of a resting arm where x_{r,k} = x and F_k = F_{r,k} = F_{k-1}; of an error ε left at this
    moment it keeps the share K̃_P/(K̃_P + K̃_I), and so on from step to step.
    """
    error_um = x_um - x_r_um
    return DsmifcState(
        history=history,
        x_r_um=x_r_um,
        error_2_um=error_um,
        error_3_um=error_um,
        force_error_mN=force_mN - force_r_mN,
        integral_mN=0.0,
    )


def step(
    parameters: DsmifcParameters,
    state: DsmifcState,
    *,
    x_um: float,
    force_mN: float,
    applied_V: float,
    x_r_um: float,
    force_r_mN: float,
    limited: int,
) -> tuple[DsmifcState, LawOutput]:
    """Compute u_k (42) with sat (32) in place of sgn; arguments and their ages as in PBSMIC.

    With x̂_k the position (17) predicts for an unchanged voltage and p̃_k = 0, and x*_k the position
    at which ε_k of (36) vanishes, (42) reads

        u_k = u_{k-1} + (k̄/d̄)[x*_k + K̃_P ε_{k-1}/(K̄ (K̃_P + K̃_I)) - x̂_k]
                      - (K̃_S/d̄) sat(s_{k-1}/δ̃)
        x*_k = x_{r,k} - [M̄ ẽ_{k-2} + B̄ ẽ_{k-1} + K̄_f (F_k - F_{r,k})]/K̄

    since s_{k-1} - K̃_I ζ_{k-1} = K̃_P ε_{k-1}: ζ moves the voltage through the switching term alone.
    """
    plant, impedance = parameters.plant, parameters.impedance
    K_P, K_I = parameters.K_P, parameters.K_I
    seen = look(plant, state.history, x_um=x_um, force_mN=force_mN, applied_V=applied_V)

    error_1_um = x_um - state.x_r_um
    error_mN = impedance_residual(
        impedance,
        error_um=error_1_um,
        error_1_um=state.error_2_um,
        error_2_um=state.error_3_um,
        force_error_mN=state.force_error_mN,
    )
    integral_mN = state.integral_mN
    if not winds_up(limited, error_mN):
        integral_mN += error_mN
    sliding_mN = K_P * error_mN + K_I * integral_mN

    x_d_um = desired_position(
        impedance,
        deviation_1_um=error_1_um,
        deviation_2_um=state.error_2_um,
        force_mN=force_mN,
        force_r_mN=force_r_mN,
        x_r_um=x_r_um,
    )
    reaching_um = K_P * error_mN / (impedance.K_bar * (K_P + K_I))
    voltage_V = (
        applied_V
        + plant.k_bar / plant.d_bar * (x_d_um + reaching_um - seen.coasting_um)
        - parameters.K_S / plant.d_bar * saturation(sliding_mN, parameters.delta)
    )
    next_state = DsmifcState(
        history=seen.history,
        x_r_um=x_r_um,
        error_2_um=error_1_um,
        error_3_um=state.error_2_um,
        force_error_mN=force_mN - force_r_mN,
        integral_mN=integral_mN,
    )
    K_bar = impedance.K_bar
    per_mN = (K_P + K_I) / plant.k_bar
    return next_state, LawOutput(
        voltage_V=voltage_V,
        x_d_um=x_d_um,
        error_um=error_mN / K_bar,
        integral_um=integral_mN / K_bar,
        sliding_um=sliding_mN / K_bar,
        band_um=sliding_band(per_mN, parameters.K_S, seen.perturbation_error_mN),
        residual_um=seen.residual_um,
        perturbation_mN=seen.perturbation_mN,
        perturbation_error_mN=seen.perturbation_error_mN,
    )
