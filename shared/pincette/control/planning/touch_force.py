"""The lowest planned force on a part, given the force that counts as a contact.

A contact is detected once the force exceeds the contact force, and the contact line is identified
during the load from there to the planned force. A planned force at or below the contact force would
already be exceeded at the contact, and a planned force only slightly above it leaves too little
load for the identification. Therefore the planned force must be above ``contact force /
FORCE_SHARE``, for every profile and for one arm or two.
"""

from collections.abc import Mapping
from math import inf
from typing import NamedTuple

from pincette.control.planning.contact_request import CONTACT_SAMPLES, force_at_touch_mN
from pincette.control.planning.feasibility import Violation

FORCE_SHARE = 0.5
"""Largest force at the moment when the contact is detected, as a fraction of the planned force."""
SEEK_SHARE = 0.75
"""Largest force on a part when the arm stops at the contact, as a fraction of the planned force."""
SEEK = "seek_um_per_s"
LOAD_PERIODS = 15
"""Smallest number of periods in a load during which the contact line is identified."""


def least_force_mN(contact_force_mN: float) -> float:
    """Return the lower bound of the planned force, in mN; a planned force must exceed it."""
    return contact_force_mN / FORCE_SHARE


def weak_force(
    force_mN: float, contact_force_mN: float, pointer: str, at_s: float
) -> tuple[Violation, ...]:
    """Return the violation of a plan whose highest force is too low; empty if it is high enough.

    Parameters
    ----------
    force_mN
        Highest force of the plan.
    pointer
        Request member that determines the force.
    at_s
        Time at which the load begins.
    """
    limit_mN = least_force_mN(contact_force_mN)
    if force_mN > limit_mN * (1.0 + 1e-9):
        return ()
    message = (
        f"force {force_mN:g} mN is not above {limit_mN:g} mN, twice the contact force of "
        f"{contact_force_mN:g} mN at which a touch is detected: plan a larger force, or a "
        "smaller contact_force_mN"
    )
    return (Violation(pointer, "force", force_mN, limit_mN, "mN", at_s, message),)


class SafeTouch(NamedTuple):
    """Limits of the speed at which an arm that stops at the contact may meet a part.

    The arm continues to move until ``CONTACT_SAMPLES`` samples show the contact, at the force
    ``force_at_touch_mN``. At the expected position the arm moves at the speed of the seek, and this
    force may be only a fraction of the planned force, so that the arm can still stop. If a part is
    met earlier, at the speed of the approach, the force must not exceed the planned force.
    """

    force_mN: float
    """Highest force of the plan, in mN."""
    contact_force_mN: float
    hardest_mN_per_um: float
    """Stiffness of the hardest permitted part, in mN/µm."""
    compliance_um_per_mN: float
    period_s: float
    seek_share: float = SEEK_SHARE
    """Largest force when the arm meets the part at the speed of the seek, as a fraction of the
    planned force."""
    approach_share: float = 1.0
    """Largest force when the arm meets a part at the speed of the approach, as a fraction of the
    planned force."""

    def limit(self, name: str) -> float:
        """Return the highest safe speed in µm/s.

        The limit is infinite if the planned force is so low that it is refused anyway.

        Parameters
        ----------
        name
            ``seek_um_per_s`` or ``approach_um_per_s``.
        """
        room_mN = self._share(name) * self.force_mN - self.contact_force_mN
        if room_mN <= 0.0:
            return inf
        per_speed_mN = force_at_touch_mN(
            0.0, self.hardest_mN_per_um, self.compliance_um_per_mN, 1.0, self.period_s
        )
        return room_mN / per_speed_mN

    def violations(self, speeds_um_per_s: Mapping[str, float]) -> tuple[Violation, ...]:
        """Return the violations of speeds, by the request members that contain them."""
        return tuple(
            self._violation(name, speed, self.limit(name))
            for name, speed in speeds_um_per_s.items()
            if speed > self.limit(name) * (1.0 + 1e-9)
        )

    def _share(self, name: str) -> float:
        return self.seek_share if name == SEEK else self.approach_share

    def _violation(self, name: str, speed: float, limit: float) -> Violation:
        at_mN = force_at_touch_mN(
            self.contact_force_mN,
            self.hardest_mN_per_um,
            self.compliance_um_per_mN,
            speed,
            self.period_s,
        )
        share = self._share(name)
        message = (
            f"{name} = {speed:g} µm/s is above {limit:.3g} µm/s: within {CONTACT_SAMPLES} "
            f"periods of {self.period_s:g} s the hardest part would be pressed with "
            f"{at_mN:.2f} mN before its touch is detected, more than {100.0 * share:g} % of "
            f"{self.force_mN:g} mN: move more slowly, shorten the period, or plan a larger "
            "force"
        )
        return Violation(f"/{name}", "speed", speed, limit, "µm/s", 0.0, message)


def short_load(load_s: float, period_s: float) -> tuple[Violation, ...]:
    """Return the violation of a load that is too short to identify the contact line."""
    least_s = LOAD_PERIODS * period_s
    if load_s >= least_s * (1.0 - 1e-9):
        return ()
    message = (
        f"load_s = {load_s:g} s is below {least_s:g} s, {LOAD_PERIODS} periods, which the "
        "identification of the contact line needs: load longer"
    )
    return (Violation("/load_s", "duration", load_s, least_s, "s", 0.0, message),)


def uncertain_force(
    force_mN: float, uncertainty_mN: float, pointer: str, what: str
) -> tuple[Violation, ...]:
    """Return the violation of a force that does not exceed its own stated uncertainty.

    Parameters
    ----------
    what
        Name of the force, such as ``contact_force_mN``.
    """
    if force_mN > uncertainty_mN:
        return ()
    message = (
        f"{what} = {force_mN:g} mN is not above {uncertainty_mN:.3g} mN, the expanded "
        "uncertainty of the force there with the model in use: plan a larger force, or "
        "calibrate free_response again with less noise"
    )
    return (Violation(pointer, "force", force_mN, uncertainty_mN, "mN", 0.0, message),)
