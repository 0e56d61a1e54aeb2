"""Correction of the model for a conditioned arm, as a table over the voltage of the rising branch.

After strokes to a low voltage an arm repeats its free motion to 0.01 mN in the median, whatever its
class of hysteresis. The identified model is less accurate. The calibration ``free_response``
therefore ends with motions that begin with such strokes, and stores

    a(u) = [x - H](u) - [x - H](u_low)

at rests of the rising branch. The free response adds a(u) in each grip that begins with such
strokes.
"""

from bisect import bisect_right
from itertools import pairwise
from math import ceil, hypot, log10

from msgspec.structs import replace

from pincette.control.record import FrozenRecord
from pincette.control.response.error_growth import ErrorGrowth, widening

STROKES, MOST_STROKES = 3, 20
"""Smallest and largest number of strokes of one conditioning."""
WAY_SHARE = 2.0
"""Smallest total voltage travel of all strokes, down and up, as a multiple of the voltage range of
the identification. The memory of Bouc-Wen hysteresis decays with the distance travelled, so that
more strokes are needed if they are shallow."""
FRESH_V = 0.1
"""Largest decrease of the voltage from its highest value since the strokes, in V, at which the arm
still counts as being on the rising branch."""
NEAR = 0.02
NEAR_V = 0.01
"""Distance from the lowest voltage at which a stroke counts as complete: a fraction of the stroke
depth, plus a value in V."""
RISE = 0.1
"""The voltage must rise above this fraction of the lowest voltage between two strokes."""
AWAY_V = 0.05
"""Distance from a measured voltage, in V, beyond which the measurement does not apply to an arm
that moves in jumps."""
OVER = 0.05
"""Fraction of the stroke depth. If the voltage rises above 0 V by more than this fraction, the
count of strokes begins again."""
PAST_CREEP = ((2.0, 0.13), (10.0, 0.07), (60.0, 0.03))
"""Uncertainty from creep that began before the strokes: time since the strokes in s, expanded
uncertainty (95 %) in mN."""


class ConditionedBranch(FrozenRecord, frozen=True):
    """Correction of the model on the rising branch of a conditioned arm; raises ValueError."""

    voltages_V: tuple[float, ...]
    """Rising sequence of voltages, in V; the first is the bottom of the strokes."""
    added_um: tuple[float, ...]
    """Position minus model at these voltages, in µm. It is 0 at the bottom, interpolated linearly
    and constant beyond the ends."""
    errors: ErrorGrowth
    """Standard error of x_1 as a function of the voltage travel since the zero of a conditioned
    grip."""
    places_V: tuple[float, ...] = ()
    """Rising sequence of voltages at which measured motions ended that began at the rest after the
    strokes, in V."""
    way_ratios: tuple[float, ...] = ()
    """Ratio of the measured motion to the motion by model and table, for each of ``places_V``."""
    way_spread: float = 0.0
    """Standard deviation of a ratio of ``way_ratios`` between repeated motions, without noise."""
    way_uneven: float = 0.0
    """Additional standard deviation of the ratio at voltages that differ from all measured ones by
    ``AWAY_V`` or more. Arms with few large relays move in jumps."""
    strokes: int = STROKES
    """Number of strokes before the measurement of the branch."""
    rest_ratio: float = 1.0
    """Ratio of the measured motion to the motion by model and table, from the lowest voltage of the
    strokes to the rest after them."""
    rest_spread: float = 0.0
    """Standard deviation of ``rest_ratio`` between conditioned motions."""
    rehearsals: int = 0
    """Number of rehearsed grips from which ``errors`` were determined. 0 if the errors
    need no correction for this number: it is large, or they are already widened for it."""

    def __post_init__(self) -> None:
        if len(self.voltages_V) != len(self.added_um) or len(self.voltages_V) < 2:
            raise ValueError(
                f"branch of {len(self.voltages_V)} voltages and {len(self.added_um)} "
                "positions: must be equal in number, at least 2"
            )
        for rising in (self.voltages_V, self.places_V):
            if not all(one < other for one, other in pairwise(rising)):
                raise ValueError("voltages of a branch must rise")
        if len(self.places_V) != len(self.way_ratios):
            raise ValueError(
                f"{len(self.places_V)} places and {len(self.way_ratios)} ratios of a motion: "
                "must be equal in number"
            )

    @property
    def low_V(self) -> float:
        """Return the lowest voltage of the strokes, in V."""
        return self.voltages_V[0]

    def at_least(self, error_um: float) -> "ConditionedBranch":
        """Return the branch with every error raised to a lower bound, in µm.

        If the bound exceeds all errors, which are known from few rehearsals, it replaces them.
        """
        errors, factor = self.errors, widening(self.rehearsals)
        if error_um < factor * max(errors.errors_um):
            return replace(self, errors=errors.at_least(error_um))
        widened = errors._replace(errors_um=tuple(factor * um for um in errors.errors_um))
        return replace(self, errors=widened.at_least(error_um), rehearsals=0)

    def way_at(self, voltage_V: float) -> tuple[float, float]:
        """Return the ratio of ``way_ratios`` for a motion to a voltage, and its standard deviation.

        Between two measured voltages the ratio is interpolated. Its standard deviation grows with
        the distance from the nearer of the two, by up to half of the difference between their
        ratios, and by up to ``way_uneven``. Beyond the outermost voltages it grows by up to the
        difference between the largest and the smallest ratio.
        """
        places_V, ratios = self.places_V, self.way_ratios
        if not places_V:
            return 1.0, self.way_spread
        after = bisect_right(places_V, voltage_V)
        if 0 < after < len(places_V):
            low, high = ratios[after - 1], ratios[after]
            gap_V = places_V[after] - places_V[after - 1]
            share = (voltage_V - places_V[after - 1]) / gap_V
            nearer = min(share, 1.0 - share)
            uneven = self.way_uneven * min(1.0, nearer * gap_V / AWAY_V)
            return low + share * (high - low), hypot(
                self.way_spread, nearer * abs(high - low), uneven
            )
        nearest = min(after, len(places_V) - 1)
        away_V = abs(voltage_V - places_V[nearest])
        share = min(1.0, away_V / max(places_V[-1] - places_V[0], AWAY_V))
        uneven = self.way_uneven * min(1.0, away_V / AWAY_V)
        return ratios[nearest], hypot(self.way_spread, share * (max(ratios) - min(ratios)), uneven)

    def at(self, voltage_V: float) -> float:
        """Return the correction a(u) of the displacement, in µm."""
        place = bisect_right(self.voltages_V, voltage_V)
        if place == 0:
            return self.added_um[0]
        if place == len(self.voltages_V):
            return self.added_um[-1]
        from_V, to_V = self.voltages_V[place - 1], self.voltages_V[place]
        from_um, to_um = self.added_um[place - 1], self.added_um[place]
        return from_um + (to_um - from_um) * (voltage_V - from_V) / (to_V - from_V)


class Strokes(FrozenRecord, frozen=True):
    """Conditioning strokes of the voltage so far, and the voltage since the last conditioning."""

    count: int = 0
    """Number of strokes that have reached the lowest voltage since the voltage was last far above 0
    V."""
    down: bool = False
    """True from the lowest voltage of a stroke until the voltage is near 0 V again."""
    bottom: bool = False
    """True while the voltage is at the lowest voltage of a stroke."""
    top_V: float = 0.0
    """Highest voltage since the lowest voltage of the last stroke, in V."""
    fell_V: float = 0.0
    """Largest decrease of the voltage below ``top_V`` since the last conditioning, in V."""
    since_s: float = 0.0
    """Time since the lowest voltage of the last stroke, in s."""
    added_um: float = 0.0
    """Correction a(top_V) after the last conditioning, in µm; kept until the next conditioning is
    complete."""

    conditioned: bool = False
    """True once a conditioning is complete, until the next one begins."""

    @property
    def complete(self) -> bool:
        """Return True while the last stroke of a conditioning is at its lowest voltage."""
        return self.conditioned and self.bottom

    @property
    def fresh(self) -> bool:
        """Return whether the arm is on the rising branch after a conditioning."""
        return self.conditioned and self.fell_V <= FRESH_V

    def updated(self, branch: ConditionedBranch, voltage_V: float, dt_s: float) -> "Strokes":
        """Update the strokes by a voltage that has been applied for ``dt_s``."""
        low_V = branch.low_V
        if voltage_V <= low_V * (1.0 - NEAR) + NEAR_V:
            return self._at_bottom(branch, voltage_V)
        if not self.conditioned:
            if voltage_V > -OVER * low_V:
                return Strokes(since_s=self.since_s + dt_s, added_um=self.added_um)
            down = self.down and voltage_V < RISE * low_V
            return Strokes(self.count, down, added_um=self.added_um)
        top_V = max(self.top_V, voltage_V)
        return Strokes(
            self.count,
            down=self.down and voltage_V < RISE * low_V,
            top_V=top_V,
            fell_V=max(self.fell_V, top_V - voltage_V),
            since_s=self.since_s + dt_s,
            added_um=self.added_um if top_V == self.top_V else branch.at(top_V),
            conditioned=True,
        )

    def _at_bottom(self, branch: ConditionedBranch, voltage_V: float) -> "Strokes":
        count = self.count
        if not self.down:
            # The first stroke after a grip belongs to the next conditioning.
            risen = self.conditioned and self.top_V > -OVER * branch.low_V
            count = 1 if risen else count + 1
        if count < branch.strokes:
            return Strokes(count, down=True, bottom=True, added_um=self.added_um)
        return Strokes(
            count,
            down=True,
            bottom=True,
            top_V=voltage_V,
            added_um=branch.at(voltage_V),
            conditioned=True,
        )


def strokes_needed(low_V: float, high_V: float) -> int:
    """Return the number of strokes to a low voltage that are needed to condition an arm.

    Parameters
    ----------
    low_V, high_V
        Voltage range of the identification. ``low_V`` is also the lowest voltage of the strokes.
    """
    wanted = ceil(WAY_SHARE * (high_V - low_V) / (2.0 * abs(low_V)))
    return min(max(STROKES, wanted), MOST_STROKES)


def past_creep_mN(since_s: float) -> float:
    """Return the expanded uncertainty in mN (95 %) from creep that began before the strokes.

    The values were determined with simulated arms of three hysteresis classes. They do not depend
    on the force.
    """
    (from_s, from_mN), *others = PAST_CREEP
    if since_s <= from_s:
        return from_mN
    for to_s, to_mN in others:
        if since_s <= to_s:
            share = log10(since_s / from_s) / log10(to_s / from_s)
            return from_mN + share * (to_mN - from_mN)
        from_s, from_mN = to_s, to_mN
    return from_mN
