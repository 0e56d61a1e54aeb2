"""Conclusions from a force, given its uncertainty U."""

from pincette.core.messages.arms import ArmEstimate


def sure_force_mN(estimate: ArmEstimate) -> float:
    """Return F after a zero; before one F - U, the least force that the free response shows."""
    if estimate.zero_age_s is not None:
        return estimate.force_mN
    return estimate.force_mN - estimate.force_uncertainty_mN


def is_uncertain(estimate: ArmEstimate, load_mN: float | None) -> bool:
    """Return whether U reaches the force of a load, so that F means nothing."""
    return load_mN is not None and estimate.force_uncertainty_mN >= load_mN
