"""The least force that a part can be pressed with, given the force that counts as a touch.

A touch is detected once the force exceeds the contact force, and the load from there to the planned
force identifies the contact line. A planned force at or below the contact force would be exceeded
by the touch itself, and one little above it leaves no load to identify the line by. So the planned
force must be above ``contact force / FORCE_SHARE``, for every profile and for one arm and two.
"""

from pincette.control.planning.feasibility import Violation

FORCE_SHARE = 0.5
"""Share of the planned force that may be there when a touch is detected."""


def least_force_mN(contact_force_mN: float) -> float:
    """Return the force that a planned force must exceed."""
    return contact_force_mN / FORCE_SHARE


def weak_force(
    force_mN: float, contact_force_mN: float, pointer: str, at_s: float
) -> tuple[Violation, ...]:
    """Return the violation of a plan whose highest force is too low; empty where it is not.

    Parameters
    ----------
    force_mN
        Highest force of the plan.
    pointer
        The member of the request that the force comes from.
    at_s
        Time at which the load begins.
    """
    limit_mN = least_force_mN(contact_force_mN)
    if force_mN > limit_mN * (1.0 + 1e-9):
        return ()
    message = (
        f"force {force_mN:g} mN is not above {limit_mN:g} mN, twice the contact force of "
        f"{contact_force_mN:g} mN at which a touch is detected: plan more force, or a smaller "
        "contact_force_mN"
    )
    return (Violation(pointer, "force", force_mN, limit_mN, "mN", at_s, message),)
