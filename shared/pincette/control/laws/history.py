"""History of the arm that PBSMIC and DSMIFC store, and its evaluation by (17).

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from pincette.control.arm.plant import DifferenceEquation, perturbation, predict_position
from pincette.control.record import FrozenRecord


class History(FrozenRecord, frozen=True):
    """History of the arm before the tick that computes u_k."""

    x_2_um: float
    """Position x_{k-2} in µm."""
    x_3_um: float
    """Position x_{k-3} in µm."""
    force_mN: float
    """Force F_{k-1} that the last tick used, in mN."""
    applied_V: float
    """Voltage u_{k-2} that was applied, in V."""
    coasting_um: float
    """Position x_{k-1} as (17) predicted it for an unchanged voltage u_{k-1} = u_{k-2}, in µm."""


class Outlook(FrozenRecord, frozen=True):
    """Residual and perturbation at the newest sample, and the next position by (17)."""

    coasting_um: float
    """Position x_k predicted by (17) for an unchanged voltage u_k = u_{k-1} and p̃_k = 0, in µm."""
    residual_um: float
    """Difference between x_{k-1} and its prediction by (17) for the applied voltage, in µm."""
    perturbation_mN: float
    """Estimated perturbation p̂_k = p_{k-1} (6), in mN."""
    perturbation_error_mN: float
    """Error p̃_{k-1} (8) of the perturbation, in mN."""
    history: History
    """History with the newest sample, for the next tick."""


def rest(*, x_um: float, force_mN: float, applied_V: float) -> History:
    """Return the history of an arm that has rested at ``x_um``."""
    return History(x_um, x_um, force_mN, applied_V, x_um)


def look(
    plant: DifferenceEquation, past: History, *, x_um: float, force_mN: float, applied_V: float
) -> Outlook:
    """Compare the newest sample x_{k-1}, F_k and u_{k-1} with the prediction from the history."""
    coasting_um = predict_position(
        plant,
        voltage_step_V=0.0,
        x_1_um=x_um,
        x_2_um=past.x_2_um,
        x_3_um=past.x_3_um,
        force_step_mN=force_mN - past.force_mN,
    )
    voltage_step_V = applied_V - past.applied_V
    residual_um = x_um - (past.coasting_um + plant.d_bar / plant.k_bar * voltage_step_V)
    return Outlook(
        coasting_um=coasting_um,
        residual_um=residual_um,
        perturbation_mN=perturbation(
            plant,
            x_um=x_um,
            x_1_um=past.x_2_um,
            x_2_um=past.x_3_um,
            voltage_V=applied_V,
            force_mN=past.force_mN,
        ),
        perturbation_error_mN=-plant.k_bar * residual_um,
        history=History(x_um, past.x_2_um, force_mN, applied_V, coasting_um),
    )
