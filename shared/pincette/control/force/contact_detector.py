"""Detection of the kink in the position of a closing arm where it meets something.

Along one branch of rising voltage the position of a free arm rises with d_p·u, at a slope that
hysteresis changes gradually. Where the arm touches a spring K_e the slope drops at once, by the
share s_p·K_e/(1 + s_p·K_e) of its value.

Two straight lines are fitted to adjacent windows of the branch, the later one up to the newest
position. A kink is where the later slope is lower by half of that share or more and the later
positions lie below the earlier line by ``SURE`` standard uncertainties. Windows of several lengths
are tried: short ones find a kink soon where the sensor is quiet and the branch bends, and long
ones average noise.
"""

from dataclasses import dataclass
from math import inf, sqrt
from typing import NamedTuple

from msgspec.structs import replace

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.record import FrozenRecord

LEAST_STEP_UM = 1.0
STEP_OVER_NOISE = 6.0
"""Least size of the fall of ``KinkLimits`` over a step, in standard deviations of the noise."""
SURE = 5.0
"""Least distance of the positions after a kink below the extrapolated line, in standard
uncertainties."""
REFUTED = 3.0
"""Number of standard deviations of the noise by which a position refutes a kink."""
BIN_UM = 0.25
"""Travel of d_p·u over which positions are summed."""
KEPT_BINS = 80
"""Number of sums that are kept, which covers the two longest windows."""
WINDOWS_UM = ((2.0, 1.5), (3.0, 2.5), (4.5, 4.0), (6.0, 5.0), (8.0, 6.0), (11.0, 8.0))
"""Lengths of the windows before and after a kink, as travels of d_p·u."""
SHORT_UM, LONG_STEPS = 5.0, 1.5
"""Length beyond which a window after a kink is used only where noise requires it, in µm and in
steps of ``KinkLimits``: over 10 µm the slope of a free arm that saturates falls by a fifth."""
LEAST_BEFORE, LEAST_AFTER = 3, 2
"""Least number of sums in a window before and after a kink."""
FILLED_BEFORE, FILLED_AFTER = 0.6, 0.5
"""Least share of its length that a window before and after a kink covers."""


@dataclass(frozen=True, slots=True)
class KinkLimits:
    """Limits beyond which a fall of the slope counts as a kink."""

    step_um: float
    """Travel of d_p·u over which noise cannot change the slope by ``drop``, in µm."""
    drop: float
    """Fall of the slope dx/(d_p·du), as a share of the slope before."""
    noise_um: float = 0.0
    """Standard deviation of the sensor's noise, in µm."""


def kink_limits(
    softest_mN_per_um: float, compliance_um_per_mN: float, noise_um: float
) -> KinkLimits:
    """Return limits for half the drop of the softest part, over a step that noise cannot bend.

    Raises
    ------
    ValueError
        If K_e or s_p is not positive, or the noise negative.
    """
    K_e = require_positive("softest contact", softest_mN_per_um, "mN/µm")
    ratio = K_e * require_positive("compliance", compliance_um_per_mN, "µm/mN")
    drop = 0.5 * ratio / (1.0 + ratio)
    noise = require_not_negative("sensor noise", noise_um, "µm")
    step_um = max(LEAST_STEP_UM, STEP_OVER_NOISE * sqrt(2.0) * noise / drop)
    return KinkLimits(step_um, drop, noise)


class DetectedContact(FrozenRecord, frozen=True):
    """Place at which the arm met something, and its motion up to there."""

    x_um: float
    nominal_um: float
    slope: float
    on_new_ground: bool = False
    """True where the arm had not been as far before; at earlier places a kink may come from the
    arm's own hysteresis."""

    def pushed_back_um(self, x_um: float, nominal_um: float) -> float:
        """Return the distance of the arm from where it would be without the touch."""
        return self.x_um + self.slope * (nominal_um - self.nominal_um) - x_um


class Sums(NamedTuple):
    """Sums over the samples of a branch up to one sample, relative to the start of the branch."""

    samples: int = 0
    nominal: float = 0.0
    x: float = 0.0
    nominal2: float = 0.0
    product: float = 0.0

    def add(self, nominal_um: float, x_um: float) -> "Sums":
        """Add a sample."""
        return Sums(
            self.samples + 1,
            self.nominal + nominal_um,
            self.x + x_um,
            self.nominal2 + nominal_um * nominal_um,
            self.product + nominal_um * x_um,
        )


class Line(NamedTuple):
    """Straight line fitted to a window of a branch."""

    samples: int
    nominal_um: float
    """Mean of d_p·u, in µm."""
    x_um: float
    """Mean position, in µm."""
    slope: float
    spread_um2: float
    """Sum of squares of d_p·u about its mean, in µm²."""

    def at(self, nominal_um: float) -> float:
        """Return the position of the line in µm."""
        return self.x_um + self.slope * (nominal_um - self.nominal_um)


def fitted(later: Sums, earlier: Sums) -> Line | None:
    """Return the line fitted to the samples between two sums, or None where d_p·u does not vary."""
    count = later.samples - earlier.samples
    nominal, x = later.nominal - earlier.nominal, later.x - earlier.x
    spread = later.nominal2 - earlier.nominal2 - nominal * nominal / count
    if spread <= 0.0:
        return None
    slope = (later.product - earlier.product - nominal * x / count) / spread
    return Line(count, nominal / count, x / count, slope, spread)


class ContactDetector(FrozenRecord, frozen=True):
    """Positions along the newest branch, and a touch found on it.

    It counts along d_p·u and not along x_1, since a model of the hysteresis that is made of plays
    has kinks of its own.
    """

    nominal_um: float
    """Value of d_p·u at the start of the branch, in µm."""
    x_um: float
    """Position at the start of the branch, in µm."""
    touch: DetectedContact | None = None
    free_to_um: float = -inf
    """Furthest position before this branch and before the touch, in µm."""
    reached_um: float = -inf
    """Furthest position on this branch before the touch, in µm."""
    begun_um: float = 0.0
    """Value of d_p·u at which the open bin begins, relative to the start of the branch, in µm."""
    open_bin: Sums = Sums()
    """Sums up to the newest sample."""
    ends_um: tuple[float, ...] = (0.0,)
    """Value of d_p·u at which each bin ends, relative to the start of the branch, in µm."""
    bins: tuple[Sums, ...] = (Sums(),)
    """Sums up to the end of each bin; the first one ends where the oldest bin begins."""

    def restarted(self, x_um: float, nominal_um: float) -> "ContactDetector":
        """Return a detector for a new branch that keeps the range known to be free."""
        return ContactDetector(nominal_um, x_um, free_to_um=max(self.free_to_um, self.reached_um))

    def updated(self, limits: KinkLimits, x_um: float, nominal_um: float) -> "ContactDetector":
        """Return the detector updated by x_k and d_p·u_{k-1}."""
        at_um = nominal_um - self.nominal_um
        if at_um <= self.begun_um - limits.step_um:
            touch = self.touch
            if touch is not None and nominal_um < touch.nominal_um:
                touch = None
            return replace(self.restarted(x_um, nominal_um), touch=touch)
        if at_um < self.begun_um:
            return self
        sums = self.open_bin.add(at_um, x_um - self.x_um)
        if at_um < self.begun_um + BIN_UM:
            return replace(self, open_bin=sums)
        closed = replace(
            self,
            open_bin=sums,
            begun_um=at_um,
            ends_um=(*self.ends_um[-KEPT_BINS:], at_um),
            bins=(*self.bins[-KEPT_BINS:], sums),
        )
        return closed._judged(limits)

    def _judged(self, limits: KinkLimits) -> "ContactDetector":
        """Return the detector after a search for a kink before the newest closed bin."""
        last, before = self.bins[-1], self.bins[-2]
        x_um = self.x_um + (last.x - before.x) / (last.samples - before.samples)
        touch = self.touch
        if touch is not None and touch.on_new_ground:
            way_um = self.nominal_um + self.ends_um[-1] - touch.nominal_um
            least_um = touch.x_um + touch.slope * (1.0 - limits.drop) * way_um
            if x_um <= least_um + REFUTED * limits.noise_um:
                return self
            touch = None
        # A kink on known ground does not hide one on new ground.
        met = self._kink(limits)
        if met is not None and (touch is None or met.on_new_ground):
            touch = met
        if touch is not None and touch.on_new_ground:
            return replace(self, touch=touch)
        return replace(self, touch=touch, reached_um=max(self.reached_um, x_um))

    def _kink(self, limits: KinkLimits) -> DetectedContact | None:
        """Return the kink that the shortest windows show, or None."""
        ends_um, bins = self.ends_um, self.bins
        last = len(bins) - 1
        middle = first = last
        longest_um = max(SHORT_UM, LONG_STEPS * limits.step_um)
        for before_um, after_um in WINDOWS_UM:
            if after_um > longest_um:
                break
            while middle > 0 and ends_um[last] - ends_um[middle] < after_um:
                middle -= 1
            first = min(first, middle)
            while first > 0 and ends_um[middle] - ends_um[first] < before_um:
                first -= 1
            if middle - first < LEAST_BEFORE or last - middle < LEAST_AFTER:
                continue
            short = ends_um[middle] - ends_um[first] < FILLED_BEFORE * before_um
            if short or ends_um[last] - ends_um[middle] < FILLED_AFTER * after_um:
                continue
            before, after = fitted(bins[middle], bins[first]), fitted(bins[last], bins[middle])
            if before is None or after is None or before.slope <= 0.0:
                continue
            if after.slope >= before.slope * (1.0 - limits.drop):
                continue
            lever_um2 = (after.nominal_um - before.nominal_um) ** 2
            variance = 1.0 / after.samples + 1.0 / before.samples + lever_um2 / before.spread_um2
            below_um = before.at(after.nominal_um) - after.x_um
            if below_um >= SURE * limits.noise_um * sqrt(variance):
                return self._met(limits, before, after, (ends_um[first], ends_um[last]))
        return None

    def _met(
        self, limits: KinkLimits, before: Line, after: Line, within_um: tuple[float, float]
    ) -> DetectedContact:
        """Return the touch where the two lines cross."""
        low_um, high_um = within_um
        crossing_um = (after.at(0.0) - before.at(0.0)) / (before.slope - after.slope)
        at_um = min(max(crossing_um, low_um), high_um)
        x_um = self.x_um + before.at(at_um)
        on_new_ground = x_um >= self.free_to_um - LEAST_STEP_UM - SURE * limits.noise_um
        return DetectedContact(x_um, self.nominal_um + at_um, before.slope, on_new_ground)
