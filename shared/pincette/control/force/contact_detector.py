"""Detection of the kink in the position of a closing arm at first contact.

Along one branch of rising voltage the position of a free arm rises with d_p·u, at a slope that
hysteresis changes gradually. Where the arm meets a spring K_e, the slope drops at once by the
fraction s_p·K_e/(1 + s_p·K_e) of its value.

Two straight lines are fitted to adjacent windows of the branch, the later one up to the newest
position. A kink is found where the later slope is lower by at least half of that fraction and the
later positions lie below the earlier line by ``SURE`` standard uncertainties. Windows of several
lengths are tried: short windows find a kink early if the sensor noise is low, even on a curved
branch; long windows average more noise.
"""

from dataclasses import dataclass
from math import inf, sqrt
from typing import NamedTuple

from msgspec.structs import replace

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.record import FrozenRecord

LEAST_STEP_UM = 1.0
STEP_OVER_NOISE = 6.0
"""Smallest drop of the position over a step of ``KinkLimits``, in standard deviations of the
noise."""
SURE = 5.0
"""Smallest distance by which the positions after a kink lie below the extrapolated line, in
standard uncertainties."""
REFUTED = 3.0
"""Deviation of a position that disproves a kink, in standard deviations of the noise."""
BIN_UM = 0.25
"""Width of a bin, the travel of d_p·u over which positions are summed, in µm."""
KEPT_BINS = 80
"""Number of bins that are kept. They cover the two longest windows."""
WINDOWS_UM = ((2.0, 1.5), (3.0, 2.5), (4.5, 4.0), (6.0, 5.0), (8.0, 6.0), (11.0, 8.0))
"""Lengths of the windows before and after a kink, as travel of d_p·u, in µm."""
SHORT_UM, LONG_STEPS = 5.0, 1.5
"""Length beyond which a window after a kink is used only if the noise requires it, in µm and in
steps of ``KinkLimits``. The slope of a free arm that saturates falls by a fifth over 10 µm."""
LEAST_BEFORE, LEAST_AFTER = 3, 2
"""Smallest number of bins in a window before and after a kink."""
FILLED_BEFORE, FILLED_AFTER = 0.6, 0.5
"""Smallest fraction of the nominal window length for which samples must exist before and after a
kink."""


@dataclass(frozen=True, slots=True)
class KinkLimits:
    """Limits that a decrease of the slope must exceed to count as a kink."""

    step_um: float
    """Travel of d_p·u, in µm, over which noise cannot change the measured slope by ``drop``."""
    drop: float
    """Decrease of the slope dx/(d_p·du), as a fraction of the slope before the kink."""
    noise_um: float = 0.0
    """Standard deviation of the sensor's noise, in µm."""


def kink_limits(
    softest_mN_per_um: float, compliance_um_per_mN: float, noise_um: float
) -> KinkLimits:
    """Return the limits: half the slope change that the softest part causes, and a safe step.

    The step is long enough that noise cannot cause such a change of the slope.

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
    """Position at which the arm met something, and its motion up to there."""

    x_um: float
    nominal_um: float
    slope: float
    on_new_ground: bool = False
    """True if the arm had not been this far before. At earlier positions its own hysteresis may
    cause a kink."""

    def pushed_back_um(self, x_um: float, nominal_um: float) -> float:
        """Return the distance in µm by which the contact has held the arm back."""
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
    """Return the line fitted to the samples between two sums, or None if d_p·u does not vary."""
    count = later.samples - earlier.samples
    nominal, x = later.nominal - earlier.nominal, later.x - earlier.x
    spread = later.nominal2 - earlier.nominal2 - nominal * nominal / count
    if spread <= 0.0:
        return None
    slope = (later.product - earlier.product - nominal * x / count) / spread
    return Line(count, nominal / count, x / count, slope, spread)


class ContactDetector(FrozenRecord, frozen=True):
    """Search for a contact along the newest branch of the motion.

    Positions are counted along d_p·u and not along x_1, because x_1 of a model made of play
    operators has kinks of its own.
    """

    nominal_um: float
    """Value of d_p·u at the start of the branch, in µm."""
    x_um: float
    """Position at the start of the branch, in µm."""
    touch: DetectedContact | None = None
    free_to_um: float = -inf
    """Furthest position before this branch and before the contact, in µm."""
    reached_um: float = -inf
    """Furthest position on this branch before the contact, in µm."""
    begun_um: float = 0.0
    """Value of d_p·u at which the open bin begins, relative to the start of the branch, in µm."""
    open_bin: Sums = Sums()
    """Sums up to the newest sample."""
    ends_um: tuple[float, ...] = (0.0,)
    """Value of d_p·u at which each bin ends, relative to the start of the branch, in µm."""
    bins: tuple[Sums, ...] = (Sums(),)
    """Sums up to the end of each bin; the first one ends where the oldest bin begins."""

    def restarted(self, x_um: float, nominal_um: float) -> "ContactDetector":
        """Return a detector for a new branch. The range known to be free is kept."""
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
        """Return the detector after a search for a kink before the newest complete bin."""
        last, before = self.bins[-1], self.bins[-2]
        x_um = self.x_um + (last.x - before.x) / (last.samples - before.samples)
        touch = self.touch
        if touch is not None and touch.on_new_ground:
            way_um = self.nominal_um + self.ends_um[-1] - touch.nominal_um
            least_um = touch.x_um + touch.slope * (1.0 - limits.drop) * way_um
            if x_um <= least_um + REFUTED * limits.noise_um:
                return self
            touch = None
        # A kink in a range known to be free does not hide one beyond that range.
        met = self._kink(limits)
        if met is not None and (touch is None or met.on_new_ground):
            touch = met
        if touch is not None and touch.on_new_ground:
            return replace(self, touch=touch)
        return replace(self, touch=touch, reached_um=max(self.reached_um, x_um))

    def _kink(self, limits: KinkLimits) -> DetectedContact | None:
        """Return the kink that the shortest conclusive windows show, or None."""
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
        """Return the contact at the intersection of the two lines."""
        low_um, high_um = within_um
        crossing_um = (after.at(0.0) - before.at(0.0)) / (before.slope - after.slope)
        at_um = min(max(crossing_um, low_um), high_um)
        x_um = self.x_um + before.at(at_um)
        on_new_ground = x_um >= self.free_to_um - LEAST_STEP_UM - SURE * limits.noise_um
        return DetectedContact(x_um, self.nominal_um + at_um, before.slope, on_new_ground)
