"""Position of the arms, and contact of two arms with a part since a segment began."""

from math import exp

from msgspec.structs import replace

from pincette.control.laws.two_arms import Pair
from pincette.control.record import FrozenRecord
from pincette.core.messages.arms import ArmEstimate

FELT_S = 0.03
"""Time constant over which the force and tip position of each side are averaged to detect a
contact, in s."""
DRIFT_S = 1.0
"""Time constant of the mean force on each free side, in s; this mean is the error of the model
during the motion."""

Arms = tuple[ArmEstimate, ...]
"""Estimate of each arm at one sample."""


def place_um(arms: Arms) -> float:
    """Return the position of one arm, or the position q of a part between two arms, in µm."""
    if len(arms) == 1:
        return arms[0].x_um
    return 0.5 * (arms[0].x_um - arms[1].x_um)


class Felt(FrozenRecord, frozen=True):
    """Forces on two arms, and positions of their tips, since a segment began."""

    tips_um: Pair
    """Positions of the tips at the newest sample, in µm."""
    mean_mN: Pair = (0.0, 0.0)
    """Force on each arm, averaged over ``FELT_S``, in mN."""
    mean_um: Pair = (0.0, 0.0)
    """Position of each tip, averaged over ``FELT_S``, in µm."""
    drift_mN: Pair = (0.0, 0.0)
    """Mean of each force since the segment began, excluding contacts, in mN."""
    felt_s: float = 0.0
    """Time since the segment began, in s."""
    fresh: bool = True
    """True if no sample of this segment has been added."""

    def entered(self) -> "Felt":
        """Return the state at the start of a segment, before its first sample."""
        return replace(self, fresh=True, drift_mN=(0.0, 0.0), felt_s=0.0)

    def updated(self, arms: Arms, period_s: float, most_drift_mN: float) -> "Felt":
        """Add the newest sample.

        A force that exceeds the drift by more than ``most_drift_mN`` is a contact and does not
        change the drift. The drift itself stays within ``most_drift_mN`` of 0.
        """
        first, second = arms
        tips = mean_um = first.x_um, second.x_um
        forces = mean_mN = first.force_mN, second.force_mN
        if not self.fresh:
            share = 1.0 - exp(-period_s / FELT_S)
            mean_mN = _towards(self.mean_mN, forces, share)
            mean_um = _towards(self.mean_um, tips, share)
        # A plain mean at first, then an average over DRIFT_S.
        felt_s = self.felt_s + period_s
        share = max(period_s / felt_s, 1.0 - exp(-period_s / DRIFT_S))
        one, two = (
            old
            if mN - old > most_drift_mN and not self.fresh
            else max(-most_drift_mN, min(most_drift_mN, old + share * (mN - old)))
            for old, mN in zip(self.drift_mN, mean_mN, strict=True)
        )
        return Felt(tips, mean_mN, mean_um, (one, two), felt_s, fresh=False)


def _towards(before: Pair, now: Pair, share: float) -> Pair:
    one, two = (old + share * (new - old) for old, new in zip(before, now, strict=True))
    return one, two
