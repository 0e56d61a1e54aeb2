"""What can be concluded from a force, given its uncertainty U."""

from pincette.core.messages.arms import ArmEstimate


def sure_force_mN(estimate: ArmEstimate) -> float:
    """Return F by a zero; before one F - U, the least that presses by the free response."""
    if estimate.zero_age_s is not None:
        return estimate.force_mN
    return estimate.force_mN - estimate.force_uncertainty_mN


def is_uncertain(estimate: ArmEstimate, load_mN: float | None) -> bool:
    """Return whether U is as large as the force that a load goes to, so that F means nothing."""
    return load_mN is not None and estimate.force_uncertainty_mN >= load_mN
