"""The force of one arm for certain, by its uncertainty U."""

from pincette.core.messages.arms import ArmEstimate


def sure_force_mN(estimate: ArmEstimate) -> float:
    """Return F by a zero; before one F - U, the least that presses by the free response."""
    if estimate.zero_age_s is not None:
        return estimate.force_mN
    return estimate.force_mN - estimate.force_uncertainty_mN
