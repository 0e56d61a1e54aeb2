"""Position-based sliding mode impedance control (PBSMIC), (16) to (32).

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. Forces are compressive: F > 0 is
the force of the grip on the object.
"""

from dataclasses import dataclass, replace

from pincette.control.impedance import DiscreteImpedance, desired_position
from pincette.control.plant import DifferenceEquation, predict_position
from pincette.control.sliding import saturation


@dataclass(frozen=True, slots=True)
class PbsmicParameters:
    """The law's model of the arm, its target impedance and its gains."""

    plant: DifferenceEquation
    impedance: DiscreteImpedance
    K_P: float
    K_I: float
    """K_P and K_I without unit; K_P ≥ 0, K_I > 0. Where the model holds, each sample takes
    the share K_I/(K_P + K_I) off the error."""
    K_S: float
    """Switching gain in mN; 0 switches it off. The slope (K_P + K_I)·K_S/(k̄·δ) inside the
    boundary layer belongs between 0 and 1."""
    delta: float
    """Half width of the boundary layer in µm."""


@dataclass(frozen=True, slots=True)
class PbsmicState:
    """What the law remembers, named as it stands before the tick that computes u_k."""

    x_2_um: float
    """x_{k-2}."""
    x_3_um: float
    """x_{k-3}."""
    x_d_um: float
    """x_{d,k-1}."""
    deviation_1_um: float
    """x_{d,k-1} - x_{r,k-1}."""
    deviation_2_um: float
    """x_{d,k-2} - x_{r,k-2}."""
    force_mN: float
    """F_{k-1}, the estimate the last tick used."""
    integral_um: float
    """ε_{k-2}."""
    applied_V: float
    """u_{k-2}, as applied."""
    coasting_um: float
    """x_{k-1} as (17) predicted it for an unchanged voltage u_{k-1} = u_{k-2}."""


@dataclass(frozen=True, slots=True)
class PbsmicOutput:
    """The voltage for tick k, and how the law sees the arm."""

    voltage_V: float
    """u_k, before any limit."""
    x_d_um: float
    """x_{d,k}."""
    error_um: float
    """e_{k-1} = x_{k-1} - x_{d,k-1}."""
    integral_um: float
    """ε_{k-1} (19)."""
    sliding_um: float
    """s_{k-1} (18)."""
    residual_um: float
    """x_{k-1} as measured, minus what (17) predicted for the voltage applied."""
    perturbation_error_mN: float
    """p̃_{k-1} = p_{k-2} - p_{k-1} (8), with the law's own F: -k̄ times the residual."""


def start(*, x_um: float, x_r_um: float, force_mN: float, applied_V: float) -> PbsmicState:
    """State of a resting arm: every past position is ``x_um``, x_d starts from there, ε = 0.

    With x_r = x and F = F_r = 0 afterwards, the first u_k is the applied voltage.
    """
    return PbsmicState(
        x_2_um=x_um,
        x_3_um=x_um,
        x_d_um=x_um,
        deviation_1_um=x_um - x_r_um,
        deviation_2_um=x_um - x_r_um,
        force_mN=force_mN,
        integral_um=0.0,
        applied_V=applied_V,
        coasting_um=x_um,
    )


def rebase(state: PbsmicState, *, x_um: float, x_r_um: float, force_mN: float) -> PbsmicState:
    """Begin another segment without a bump, just before the step that gets the same ``x_um``.

    x_d starts from ``x_um``, ε = 0, and F_k - F_{k-1} counts from ``force_mN``, so that a force
    which the law was not fed before does not act as a step. What was measured and applied stays.
    The step that follows keeps the voltage of a resting arm where x_{r,k} = x and F_k = F_{r,k};
    a distance x_r - x or a force error left at this moment is taken up with the impedance (14).
    """
    deviation_um = x_um - x_r_um
    return replace(
        state,
        x_d_um=x_um,
        deviation_1_um=deviation_um,
        deviation_2_um=deviation_um,
        force_mN=force_mN,
        integral_um=0.0,
    )


def step(
    parameters: PbsmicParameters,
    state: PbsmicState,
    *,
    x_um: float,
    force_mN: float,
    applied_V: float,
    x_r_um: float,
    force_r_mN: float,
    freeze_integral: bool,
) -> tuple[PbsmicState, PbsmicOutput]:
    """Compute u_k (25) with sat (32) in place of sgn.

    Which sample is which: (4) is backward Euler, so x_k is the position *after* u_k has acted.
    At the tick that computes u_k the newest measurement is therefore x_{k-1}, while the newest
    force estimate serves as F_k:

    ==================  ============  ====================================================
    ``x_um``            x_{k-1}       newest measurement
    ``force_mN``        F_k           newest estimate
    ``applied_V``       u_{k-1}       really applied in the last tick: the anti-windup
    ``x_r_um``          x_{r,k}       reference for after u_k has acted
    ``force_r_mN``      F_{r,k}       likewise
    ==================  ============  ====================================================

    With x̂_k the position (17) predicts for an unchanged voltage and p̃_k = 0, (25) reads

        u_k = u_{k-1} + (k̄/d̄)[x_{d,k} + K_P e_{k-1}/(K_P + K_I) - x̂_k] - (K_S/d̄) sat(s_{k-1}/δ)

    since s_{k-1} - K_I ε_{k-1} = K_P e_{k-1}: ε moves the voltage through the switching term
    alone. ``freeze_integral``, set while a limit acts outward, keeps ε as it is.
    """
    plant = parameters.plant
    K_I = parameters.K_I

    error_um = x_um - state.x_d_um
    integral_um = state.integral_um if freeze_integral else state.integral_um + error_um
    sliding_um = parameters.K_P * error_um + K_I * integral_um

    x_d_um = desired_position(
        parameters.impedance,
        deviation_1_um=state.deviation_1_um,
        deviation_2_um=state.deviation_2_um,
        force_mN=force_mN,
        force_r_mN=force_r_mN,
        x_r_um=x_r_um,
    )
    coasting_um = predict_position(
        plant,
        voltage_step_V=0.0,
        x_1_um=x_um,
        x_2_um=state.x_2_um,
        x_3_um=state.x_3_um,
        force_step_mN=force_mN - state.force_mN,
    )
    reaching_um = parameters.K_P * error_um / (parameters.K_P + K_I)
    voltage_V = (
        applied_V
        + plant.k_bar / plant.d_bar * (x_d_um + reaching_um - coasting_um)
        - parameters.K_S / plant.d_bar * saturation(sliding_um, parameters.delta)
    )

    voltage_step_V = applied_V - state.applied_V
    residual_um = x_um - (state.coasting_um + plant.d_bar / plant.k_bar * voltage_step_V)
    next_state = PbsmicState(
        x_2_um=x_um,
        x_3_um=state.x_2_um,
        x_d_um=x_d_um,
        deviation_1_um=x_d_um - x_r_um,
        deviation_2_um=state.deviation_1_um,
        force_mN=force_mN,
        integral_um=integral_um,
        applied_V=applied_V,
        coasting_um=coasting_um,
    )
    return next_state, PbsmicOutput(
        voltage_V=voltage_V,
        x_d_um=x_d_um,
        error_um=error_um,
        integral_um=integral_um,
        sliding_um=sliding_um,
        residual_um=residual_um,
        perturbation_error_mN=-plant.k_bar * residual_um,
    )
