"""Position-based sliding mode impedance control (PBSMIC), (16) to (32).

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. Forces are compressive: F > 0 is
the force of the grip on the object.
"""

from pincette.control.laws.definition import LawDefinition
from pincette.control.laws.history import History, look
from pincette.control.laws.impedance import (
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


class PbsmicState(FrozenRecord, frozen=True):
    """State of the law before the tick that computes u_k."""

    history: History
    x_d_um: float
    """Desired position x_{d,k-1}, in µm."""
    deviation_1_um: float
    """Deviation x_{d,k-1} - x_{r,k-1}, in µm."""
    deviation_2_um: float
    """Deviation x_{d,k-2} - x_{r,k-2}, in µm."""
    integral_um: float
    """Integral ε_{k-2}, in µm."""


def start(
    _parameters: SlidingParameters,
    history: History,
    *,
    x_um: float,
    x_r_um: float,
    force_error_mN: float,  # noqa: ARG001  as every law; the impedance takes the error up
) -> PbsmicState:
    """Return the state for a bumpless start, just before the step with the same ``x_um``.

    x_d starts at ``x_um``, and ε at 0. The next step does not change the voltage of a resting arm
    if x_{r,k} = x and F_k = F_{r,k} = F_{k-1}. A difference x_r - x or a force error at this moment
    decays with the impedance (14). With x_d(0) = x_r(0), as in (15), this difference would be an
    error e instead. Both starts are equal if the reference starts at the position of the arm.
    """
    deviation_um = x_um - x_r_um
    return PbsmicState(
        history=history,
        x_d_um=x_um,
        deviation_1_um=deviation_um,
        deviation_2_um=deviation_um,
        integral_um=0.0,
    )


def step(
    parameters: SlidingParameters,
    state: PbsmicState,
    *,
    x_um: float,
    force_mN: float,
    applied_V: float,
    x_r_um: float,
    force_r_mN: float,
    limited: int,
) -> tuple[PbsmicState, LawOutput]:
    """Compute u_k (25) with sat (32) instead of sgn.

    Sample indices: (4) is backward Euler, so x_k is the position *after* u_k has acted. At the tick
    that computes u_k the newest measurement is therefore x_{k-1}, while the newest force is used as
    F_k:

    ==================  ============  ====================================================
    ``x_um``            x_{k-1}       newest measurement
    ``force_mN``        F_k           newest force; ``force_input`` for its age
    ``applied_V``       u_{k-1}       really applied in the last tick: the anti-windup
    ``x_r_um``          x_{r,k}       reference for after u_k has acted
    ``force_r_mN``      F_{r,k}       reference for after u_k has acted
    ==================  ============  ====================================================

    With the position x̂_k that (17) predicts for an unchanged voltage and p̃_k = 0, (25) is

        u_k = u_{k-1} + (k̄/d̄)[x_{d,k} + K_P e_{k-1}/(K_P + K_I) - x̂_k] - (K_S/d̄) sat(s_{k-1}/δ)

    since s_{k-1} - K_I ε_{k-1} = K_P e_{k-1}: ε affects the voltage through the switching term
    only. For ``limited`` see ``winds_up``; an error that winds up is not added to ε.
    """
    seen = look(parameters.plant, state.history, x_um=x_um, force_mN=force_mN, applied_V=applied_V)
    x_d_um = desired_position(
        parameters.impedance,
        deviation_1_um=state.deviation_1_um,
        deviation_2_um=state.deviation_2_um,
        force_mN=force_mN,
        force_r_mN=force_r_mN,
        x_r_um=x_r_um,
    )
    integral_um, output = sliding_output(
        parameters,
        seen,
        applied_V=applied_V,
        x_d_um=x_d_um,
        error=x_um - state.x_d_um,
        integral=state.integral_um,
        limited=limited,
        per_um=1.0,
    )
    after = PbsmicState(
        history=seen.history,
        x_d_um=x_d_um,
        deviation_1_um=x_d_um - x_r_um,
        deviation_2_um=state.deviation_1_um,
        integral_um=integral_um,
    )
    return after, output


LAW = LawDefinition(
    name="pbsmic",
    title="PBSMIC",
    summary="position-based sliding mode impedance control: the arm follows the target position of "
    "the impedance",
    parameters=sliding_parameters("µm", delta=100.0, K_P=1.0, K_S=0.003),
    build=build,
    start=start,
    step=step,
    impedance=impedance_of,
    search=SEARCH,
    switching=SWITCHING,
    remedies=remedies,
)
