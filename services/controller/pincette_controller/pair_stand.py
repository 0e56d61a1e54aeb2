"""Forces and touches of two arms since a segment began."""

from math import exp
from typing import NamedTuple

from msgspec.structs import replace

from pincette.control.laws.two_arms import Pair
from pincette.control.record import FrozenRecord
from pincette.core.messages import Estimate
from pincette_controller.force_bounds import sure_force_mN

FELT_S = 0.03
"""Time constant over which each side's force and tip are averaged, for a touch to be told."""
DRIFT_S = 1.0
"""Over which each free side's force is followed: what its model errs by along the way."""


class Seen(NamedTuple):
    """An estimate of both arms."""

    tips_um: Pair
    forces_mN: Pair
    sure_mN: Pair
    """F_i by a zero; before one F_i - U_i, the least that presses."""
    zero_ages_s: tuple[float | None, float | None]
    zero_refused: bool
    zeros_unconfirmed: tuple[bool, bool]
    """True for an arm whose zero may hide the force of a part that pressed when it was taken."""
    touches: tuple[tuple[float | None, float], tuple[float | None, float]]
    """For each arm that should be free: position of a touch, and the least force of it."""
    applied_V: Pair

    @property
    def place_um(self) -> float:
        """q."""
        return 0.5 * (self.tips_um[0] - self.tips_um[1])

    @property
    def opening_um(self) -> float:
        """x_1 + x_2."""
        return self.tips_um[0] + self.tips_um[1]


def seen(estimate: Estimate) -> Seen:
    """Both arms of an estimate; raises ValueError where it has one."""
    first, second = estimate.arms
    return Seen(
        tips_um=(first.x_um, second.x_um),
        forces_mN=(first.force_mN, second.force_mN),
        sure_mN=(sure_force_mN(first), sure_force_mN(second)),
        zero_ages_s=(first.zero_age_s, second.zero_age_s),
        zero_refused=bool(first.zero_refusal or second.zero_refusal),
        zeros_unconfirmed=(first.zero_unconfirmed, second.zero_unconfirmed),
        touches=(
            (first.touch_x_um, first.touch_mN or 0.0),
            (second.touch_x_um, second.touch_mN or 0.0),
        ),
        applied_V=(first.applied_V, second.applied_V),
    )


class PairStand(FrozenRecord, frozen=True):
    """Forces and tips since a segment began."""

    tips_um: Pair
    """Tips at the newest sample."""
    felt_mN: Pair = (0.0, 0.0)
    felt_um: Pair = (0.0, 0.0)
    """Forces and tips, low-passed since the segment began."""
    drift_mN: Pair = (0.0, 0.0)
    """What was read of both forces since then before anything was touched."""
    felt_s: float = 0.0
    """For how long."""
    fresh: bool = True
    """Whether nothing has been felt in this segment."""

    def entered(self) -> "PairStand":
        """Return the state at the begin of a segment, in which nothing has been felt."""
        return replace(self, fresh=True, drift_mN=(0.0, 0.0), felt_s=0.0)

    def follow(self, now: Seen, period_s: float, most_drift_mN: float = 0.0) -> "PairStand":
        """Take in the newest sample.

        What rises by more than ``most_drift_mN`` above the drift is a touch, which the drift does
        not follow; nor does it go further than that from 0.
        """
        forces, tips = now.forces_mN, now.tips_um
        if not self.fresh:
            share = 1.0 - exp(-period_s / FELT_S)
            forces = _towards(self.felt_mN, forces, share)
            tips = _towards(self.felt_um, tips, share)
        # A mean first, then one over DRIFT_S.
        felt_s = self.felt_s + period_s
        share = max(period_s / felt_s, 1.0 - exp(-period_s / DRIFT_S))
        one, two = (
            old
            if mN - old > most_drift_mN and not self.fresh
            else max(-most_drift_mN, min(most_drift_mN, old + share * (mN - old)))
            for old, mN in zip(self.drift_mN, forces, strict=True)
        )
        return replace(
            self,
            tips_um=now.tips_um,
            felt_mN=forces,
            felt_um=tips,
            drift_mN=(one, two),
            felt_s=felt_s,
            fresh=False,
        )


def _towards(before: Pair, now: Pair, share: float) -> Pair:
    one, two = (old + share * (new - old) for old, new in zip(before, now, strict=True))
    return one, two
