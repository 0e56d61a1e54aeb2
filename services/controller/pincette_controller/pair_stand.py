"""Where a program of two arms stands beside what ``Player`` has: openings, sides, second voltage.

``Player.x_r_um`` and its speed are then those of the part's place q = (x_1 - x_2)/2.
"""

from math import exp
from typing import NamedTuple

from msgspec import UNSET
from msgspec.structs import replace

from pincette.control.laws.two_arms import Pair
from pincette.control.planning.program import BothArms
from pincette.control.record import FrozenRecord
from pincette.core.messages import Estimate

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
    touches: tuple[tuple[float | None, float], tuple[float | None, float]]
    """Of each arm that should be free: where it has met something, and at least how hard."""
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
    second = estimate.second
    if second is UNSET:
        raise ValueError("the estimate has one arm")
    arms = estimate, second
    forces = estimate.force_mN, second.force_mN
    sure = tuple(
        arm.force_mN - (0.0 if arm.zero_age_s is not None else arm.force_uncertainty_mN)
        for arm in arms
    )
    return Seen(
        tips_um=(estimate.x_um, second.x_um),
        forces_mN=forces,
        sure_mN=(sure[0], sure[1]),
        zero_ages_s=(estimate.zero_age_s, second.zero_age_s),
        zero_refused=bool(estimate.zero_refusal or second.zero_refusal),
        touches=(
            (estimate.touch_x_um, estimate.touch_mN or 0.0),
            (second.touch_x_um, second.touch_mN or 0.0),
        ),
        applied_V=(estimate.applied_V, second.applied_V),
    )


class PairStand(FrozenRecord, frozen=True):
    """References of the coming sample, and what has been felt."""

    opening_um: float
    """d_r."""
    begin_um: Pair
    """Tips, and"""
    begin_V: float
    """the second voltage, where the program began."""
    tips_um: Pair
    """Of the newest sample."""
    second_applied_V: float
    second_from_V: float
    second_voltage_V: float
    """What an open-loop segment asks of the second output."""
    opening_speed_um_per_s: float = 0.0
    acceleration_um_per_s2: float = 0.0
    """Of the place."""
    force_rate_mN_per_s: float = 0.0
    from_opening_um: float = 0.0
    from_opening_speed_um_per_s: float = 0.0
    felt_mN: Pair = (0.0, 0.0)
    felt_um: Pair = (0.0, 0.0)
    """Forces and tips, low-passed since the segment began."""
    drift_mN: Pair = (0.0, 0.0)
    """What was read of both forces since then before anything was touched."""
    felt_s: float = 0.0
    """For how long."""
    fresh: bool = True
    """Whether nothing has been felt in this segment."""
    found_first_um: float | None = None
    found_second_um: float | None = None
    """Where each arm has touched the part."""

    def entered(self) -> "PairStand":
        """At the begin of a segment, with references as they are."""
        return replace(
            self,
            from_opening_um=self.opening_um,
            from_opening_speed_um_per_s=self.opening_speed_um_per_s,
            second_from_V=self.second_applied_V,
            second_voltage_V=self.second_applied_V,
            fresh=True,
            drift_mN=(0.0, 0.0),
            felt_s=0.0,
        )

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
            second_applied_V=now.applied_V[1],
            felt_mN=forces,
            felt_um=tips,
            drift_mN=(one, two),
            felt_s=felt_s,
            fresh=False,
        )

    def left(self) -> "PairStand":
        """With the opening as it is measured, where arms begin to be led without a force."""
        return replace(
            self, opening_um=self.tips_um[0] + self.tips_um[1], opening_speed_um_per_s=0.0
        )

    def goals_um(self, both: BothArms | None, from_um: float) -> tuple[float | None, float | None]:
        """Tips that a segment leads to, from the place it began at; None where one stays."""
        if both is None:
            return None, None
        goals = both.first_to_um, both.second_to_um
        if not both.relative:
            return goals
        found = self.found_first_um, self.found_second_um
        start = 0.5 * self.from_opening_um + from_um, 0.5 * self.from_opening_um - from_um
        one, two = (
            None if goal is None else goal + (at if touched is None else touched)
            for goal, touched, at in zip(goals, found, start, strict=True)
        )
        return one, two


def _towards(before: Pair, now: Pair, share: float) -> Pair:
    one, two = (old + share * (new - old) for old, new in zip(before, now, strict=True))
    return one, two
