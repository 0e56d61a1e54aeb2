"""The least planned force on a part, given the force that counts as a touch.

A touch is detected once the force exceeds the contact force, and the load from there to the planned
force identifies the contact line. A planned force at or below the contact force would be exceeded
by the touch itself, and one little above it leaves no load to identify the line by. So the planned
force must be above ``contact force / FORCE_SHARE``, for every profile and for one arm and two.
"""

from collections.abc import Mapping
from math import inf
from typing import NamedTuple

from pincette.control.planning.contact_request import CONTACT_SAMPLES, force_at_touch_mN
from pincette.control.planning.feasibility import Violation

FORCE_SHARE = 0.5
"""Largest share of the planned force at the detection of a touch."""
SEEK_SHARE = 0.75
"""Largest share of the planned force on a part when the arm stops at the touch."""
SEEK = "seek_um_per_s"
LOAD_PERIODS = 15
"""Fewest periods of a load that identifies the contact line meanwhile."""


def least_force_mN(contact_force_mN: float) -> float:
    """Return the force that a planned force must exceed, in mN."""
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
        The member of the request that the force comes from.
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
    """Limits of the speed at which an arm that stops at the touch may meet a part.

    The arm goes on until ``CONTACT_SAMPLES`` samples show the touch, which gives
    ``force_at_touch_mN``. Where the part is expected, at the speed of the seek, only a share of the
    planned force may have been reached then, so that the arm can still stop. A part that is met
    early, at the speed of the approach, must not be pressed harder than planned.
    """

    force_mN: float
    """Highest force of the plan, in mN."""
    contact_force_mN: float
    hardest_mN_per_um: float
    """Stiffness of the hardest part that may be met, in mN/µm."""
    compliance_um_per_mN: float
    period_s: float
    seek_share: float = SEEK_SHARE
    """Largest share of the planned force at a touch at the speed of the seek."""
    approach_share: float = 1.0
    """Largest share of the planned force at a touch at the speed of the approach."""

    def limit(self, name: str) -> float:
        """Return the highest safe speed in µm/s.

        The speed is infinite for a force that is refused in any case.

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
        """Return the violations of speeds, by the request members that state them."""
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
    force_mN: float, uncertainty_mN: float, pointer: str, what: str, at_s: float = 0.0
) -> tuple[Violation, ...]:
    """Return the violation of a force that is not above its own stated uncertainty.

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
    return (Violation(pointer, "force", force_mN, uncertainty_mN, "mN", at_s, message),)
