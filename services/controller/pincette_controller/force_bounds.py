"""Lower bound of a force with uncertainty U, and whether U is at least as large as a load."""

from pincette.core.messages.arms import ArmEstimate


def sure_force_mN(estimate: ArmEstimate) -> float:
    """Return F after a zero. Before a zero return F - U, a lower bound, where F is computed from
    the free response.
    """
    if estimate.zero_age_s is not None:
        return estimate.force_mN
    return estimate.force_mN - estimate.force_uncertainty_mN


def is_uncertain(estimate: ArmEstimate, load_mN: float | None) -> bool:
    """Return whether U is at least as large as the force of a load, so that F says nothing about
    it.
    """
    return load_mN is not None and estimate.force_uncertainty_mN >= load_mN
