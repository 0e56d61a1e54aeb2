"""Deviation of a conditioned arm from the model, a table over the rising branch's voltage.

After strokes to a low voltage an arm repeats its free way to 0.01 mN in the median, whatever
its class of hysteresis. The identified model repeats it worse. ``free_response`` therefore ends
with ways that begin with the strokes, and keeps

    a(u) = [x - H](u) - [x - H](u_low)

at rests of the rising branch. The free response adds it in each grip that begins with the strokes.
"""

from bisect import bisect_right
from itertools import pairwise
from math import ceil, hypot, log10

from msgspec.structs import replace

from pincette.control.record import FrozenRecord
from pincette.control.response.error_growth import ErrorGrowth, widening

STROKES, MOST_STROKES = 3, 20
"""Fewest and most strokes of one conditioning."""
WAY_SHARE = 2.0
"""Way of all strokes, down and up, as a share of the range that the model was identified over. Arms
of the Bouc-Wen class forget by the length of the way, so that shallow strokes must be more
numerous."""
FRESH_V = 0.1
"""Fall below the highest voltage since the strokes, in V, up to which the branch still counts as
rising."""
NEAR = 0.02
NEAR_V = 0.01
"""Distance from the bottom at which a stroke counts as complete, as a share of its depth and in V.
"""
RISE = 0.1
"""Share of the depth below 0 V to which the voltage must rise between two strokes."""
AWAY_V = 0.05
"""Distance from a measured place, in V, beyond which it says nothing about an arm that moves in
jumps."""
OVER = 0.05
"""Share of the depth above 0 V beyond which a way no longer counts as a stroke."""
PAST_CREEP = ((2.0, 0.13), (10.0, 0.07), (60.0, 0.03))
"""Creep from before the strokes: time since them in s, expanded uncertainty (95 %) in mN."""


class ConditionedBranch(FrozenRecord, frozen=True):
    """The rising branch of a conditioned arm as a correction of the model; raises ValueError."""

    voltages_V: tuple[float, ...]
    """Voltages that rise from the bottom of the strokes, in V."""
    added_um: tuple[float, ...]
    """Position minus model at these voltages, in µm; 0 at the bottom, linear in between, constant
    beyond."""
    errors: ErrorGrowth
    """Standard error of x_1 over the way of the voltage since the zero of a conditioned grip."""
    places_V: tuple[float, ...] = ()
    """Rising voltages of the places to which the way from the rest after the strokes was measured,
    in V."""
    way_ratios: tuple[float, ...] = ()
    """Ratio of the measured way to each of these places to the way by model and table."""
    way_spread: float = 0.0
    """Standard deviation of such a ratio between conditioned ways, without noise."""
    way_uneven: float = 0.0
    """Standard deviation of the ratio at a place that is ``AWAY_V`` or further from the measured
    ones, since arms of few large relays move in jumps."""
    strokes: int = STROKES
    """Number of strokes before the measurement of the branch."""
    rest_ratio: float = 1.0
    """Ratio of the measured way from the bottom to the rest after the strokes to that by model and
    table."""
    rest_spread: float = 0.0
    """Standard deviation of that ratio between conditioned ways."""
    rehearsals: int = 0
    """Number of rehearsed grips that ``errors`` come from; 0: so many that the number does not
    matter, or the errors are widened for it."""

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
        """Return the voltage at the bottom of the strokes, in V."""
        return self.voltages_V[0]

    def at_least(self, error_um: float) -> "ConditionedBranch":
        """Return the branch with every error raised to a lower bound, in µm.

        A bound that no rehearsal could exceed replaces what the few rehearsals have shown.
        """
        errors, factor = self.errors, widening(self.rehearsals)
        if error_um < factor * max(errors.errors_um):
            return replace(self, errors=errors.at_least(error_um))
        widened = errors._replace(errors_um=tuple(factor * um for um in errors.errors_um))
        return replace(self, errors=widened.at_least(error_um), rehearsals=0)

    def way_at(self, voltage_V: float) -> tuple[float, float]:
        """Return the ratio of the way to a place, and the standard deviation of that ratio.

        Between two measured places the ratio is interpolated. Its deviation grows with the distance
        from the nearer one: up to half of their difference, and up to ``way_uneven``. Beyond the
        outermost places it grows up to the full difference of the ratios.
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
        """Return a(u) in µm."""
        place = bisect_right(self.voltages_V, voltage_V)
        if place == 0:
            return self.added_um[0]
        if place == len(self.voltages_V):
            return self.added_um[-1]
        from_V, to_V = self.voltages_V[place - 1], self.voltages_V[place]
        from_um, to_um = self.added_um[place - 1], self.added_um[place]
        return from_um + (to_um - from_um) * (voltage_V - from_V) / (to_V - from_V)


class Strokes(FrozenRecord, frozen=True):
    """Conditioning strokes that the voltage has made, and its path since."""

    count: int = 0
    """Number of arrivals at the bottom since the voltage was last far above 0 V."""
    down: bool = False
    """True from the bottom of a stroke until the voltage is near 0 V again."""
    bottom: bool = False
    """True while the voltage is at the bottom."""
    top_V: float = 0.0
    """Highest voltage since the last bottom of a conditioning, in V."""
    fell_V: float = 0.0
    """Furthest fall of the voltage below ``top_V`` since then, in V."""
    since_s: float = 0.0
    """Time since that bottom, in s."""
    added_um: float = 0.0
    """Correction a(top_V) of the last conditioning, until the next one is complete, in µm."""

    conditioned: bool = False
    """True once a conditioning is complete, until the next one begins."""

    @property
    def complete(self) -> bool:
        """Return whether this is the bottom of the last stroke of a conditioning."""
        return self.conditioned and self.bottom

    @property
    def fresh(self) -> bool:
        """Return whether the arm is on the rising branch after a conditioning."""
        return self.conditioned and self.fell_V <= FRESH_V

    def updated(self, branch: ConditionedBranch, voltage_V: float, dt_s: float) -> "Strokes":
        """Update the strokes by a voltage that has been applied for a time."""
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
            # After a grip the first stroke of the next conditioning begins.
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
    """Return the number of strokes to a low voltage that condition an arm.

    Parameters
    ----------
    low_V, high_V
        Voltages that the model was identified between; ``low_V`` is the bottom of the strokes.
    """
    wanted = ceil(WAY_SHARE * (high_V - low_V) / (2.0 * abs(low_V)))
    return min(max(STROKES, wanted), MOST_STROKES)


def past_creep_mN(since_s: float) -> float:
    """Return the expanded uncertainty in mN (95 %) of creep from before the strokes.

    It was found on simulated arms of three classes and does not depend on the force.
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
