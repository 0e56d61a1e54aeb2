"""Discrete-time sliding mode impedance force control (DSMIFC), (33) to (45).

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. Forces are compressive: F > 0 is the
force of the grip on the object. K_I in (39) and (44) as printed stands for K̃_I.
"""

from pincette.control.laws.definition import LawDefinition
from pincette.control.laws.history import History, look
from pincette.control.laws.impedance import (
    DiscreteImpedance,
    desired_position,
    impedance_of,
)
from pincette.control.laws.sliding import (
    SEARCH,
    SWITCHING,
    LawOutput,
    SlidingParameters,
    build,
    remedies,
    sliding_output,
    sliding_parameters,
)
from pincette.control.record import FrozenRecord


class DsmifcState(FrozenRecord, frozen=True):
    """State of the law before the tick that computes u_k."""

    history: History
    x_r_um: float
    """Reference x_{r,k-1} in µm."""
    error_2_um: float
    """Position error ẽ_{k-2} = x_{k-2} - x_{r,k-2} in µm."""
    error_3_um: float
    """Position error ẽ_{k-3} in µm."""
    force_error_mN: float
    """Force error F_{k-1} - F_{r,k-1} that the last tick used, in mN."""
    integral_mN: float
    """Integral ζ_{k-2} in mN."""


def start(
    _parameters: SlidingParameters,
    history: History,
    *,
    x_um: float,
    x_r_um: float,
    force_error_mN: float,
) -> DsmifcState:
    """Return the state for a bumpless start, just before the step with the same ``x_um``.

    ζ is 0, and the arm is assumed to have rested at its position. The next step does not change the
    voltage of a resting arm if x_{r,k} = x and F_k = F_{r,k} = F_{k-1}. If there is an error ε at
    this moment, each step multiplies it by K̃_P/(K̃_P + K̃_I).
    """
    error_um = x_um - x_r_um
    return DsmifcState(
        history=history,
        x_r_um=x_r_um,
        error_2_um=error_um,
        error_3_um=error_um,
        force_error_mN=force_error_mN,
        integral_mN=0.0,
    )


def step(
    parameters: SlidingParameters,
    state: DsmifcState,
    *,
    x_um: float,
    force_mN: float,
    applied_V: float,
    x_r_um: float,
    force_r_mN: float,
    limited: int,
) -> tuple[DsmifcState, LawOutput]:
    """Compute u_k (42) with sat (32) instead of sgn; the arguments and their ages are as in PBSMIC.

    Let x̂_k be the position that (17) predicts for an unchanged voltage and p̃_k = 0, and x*_k the
    position at which ε_k of (36) vanishes. Then (42) is

        u_k = u_{k-1} + (k̄/d̄)[x*_k + K̃_P ε_{k-1}/(K̄ (K̃_P + K̃_I)) - x̂_k]
                      - (K̃_S/d̄) sat(s_{k-1}/δ̃)
        x*_k = x_{r,k} - [M̄ ẽ_{k-2} + B̄ ẽ_{k-1} + K̄_f (F_k - F_{r,k})]/K̄

    since s_{k-1} - K̃_I ζ_{k-1} = K̃_P ε_{k-1}: ζ affects the voltage through the switching term
    only.
    """
    impedance = parameters.impedance
    seen = look(parameters.plant, state.history, x_um=x_um, force_mN=force_mN, applied_V=applied_V)
    error_1_um = x_um - state.x_r_um
    error_mN = impedance_residual(
        impedance,
        error_um=error_1_um,
        error_1_um=state.error_2_um,
        error_2_um=state.error_3_um,
        force_error_mN=state.force_error_mN,
    )
    x_d_um = desired_position(
        impedance,
        deviation_1_um=error_1_um,
        deviation_2_um=state.error_2_um,
        force_mN=force_mN,
        force_r_mN=force_r_mN,
        x_r_um=x_r_um,
    )
    integral_mN, output = sliding_output(
        parameters,
        seen,
        applied_V=applied_V,
        x_d_um=x_d_um,
        error=error_mN,
        integral=state.integral_mN,
        limited=limited,
        per_um=impedance.K_bar,
    )
    after = DsmifcState(
        history=seen.history,
        x_r_um=x_r_um,
        error_2_um=error_1_um,
        error_3_um=state.error_2_um,
        force_error_mN=force_mN - force_r_mN,
        integral_mN=integral_mN,
    )
    return after, output


def impedance_residual(
    impedance: DiscreteImpedance,
    *,
    error_um: float,
    error_1_um: float,
    error_2_um: float,
    force_error_mN: float,
) -> float:
    """Return the impedance measure error (33) in mN, from ẽ = x - x_r of three samples.

    It is the residual M̄ ẽ_{k-2} + B̄ ẽ_{k-1} + K̄ ẽ_k + K̄_f (F_k - F_{r,k}) of the impedance
    (12).
    """
    return (
        impedance.M_bar * error_2_um
        + impedance.B_bar * error_1_um
        + impedance.K_bar * error_um
        + impedance.K_f_bar * force_error_mN
    )


LAW = LawDefinition(
    name="dsmifc",
    title="DSMIFC",
    summary="discrete-time sliding mode impedance force control: the impedance itself is the "
    "sliding function",
    parameters=sliding_parameters("mN", delta=1e6, K_P=2.0, K_S=1e3),
    build=build,
    start=start,
    step=step,
    impedance=impedance_of,
    search=SEARCH,
    switching=SWITCHING,
    remedies=remedies,
)
