"""The arm's past that both laws keep, and its evaluation by (17).

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from pincette.control.arm.plant import DifferenceEquation, perturbation, predict_position
from pincette.control.record import FrozenRecord


class History(FrozenRecord, frozen=True):
    """The arm's past before the tick that computes u_k."""

    x_2_um: float
    """x_{k-2}."""
    x_3_um: float
    """x_{k-3}."""
    force_mN: float
    """F_{k-1}, as the last tick used it."""
    applied_V: float
    """u_{k-2}, as applied."""
    coasting_um: float
    """x_{k-1} as (17) predicted it for an unchanged voltage u_{k-1} = u_{k-2}."""


class Outlook(FrozenRecord, frozen=True):
    """Residual and perturbation at the newest sample, and the next position by (17)."""

    coasting_um: float
    """x_k for an unchanged voltage u_k = u_{k-1} and p̃_k = 0."""
    residual_um: float
    """x_{k-1} minus what (17) predicted for the voltage applied."""
    perturbation_mN: float
    """p̂_k = p_{k-1} (6)."""
    perturbation_error_mN: float
    """p̃_{k-1} (8)."""
    history: History
    """History with the newest sample, for the next tick."""


def rest(*, x_um: float, force_mN: float, applied_V: float) -> History:
    """Return the history of an arm that has rested at ``x_um``."""
    return History(x_um, x_um, force_mN, applied_V, x_um)


def look(
    plant: DifferenceEquation, past: History, *, x_um: float, force_mN: float, applied_V: float
) -> Outlook:
    """Compare the newest sample x_{k-1}, F_k and u_{k-1} with the past."""
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
