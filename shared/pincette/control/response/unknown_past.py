"""Range of the free response x_1 for an unknown history of the voltage before the program's start.

A newly started program knows neither the turning points of the voltage nor the creep of the arm. It
only knows a range that the voltage cannot have left. Play operators with one input preserve the
order of their states (M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, Springer 1996,
chapter 2), so the two histories that come directly from either end of the range enclose all others,
provided that the weights are not negative. Both are updated with the same voltages as the model in
use. The change of their differences from the model after a zero bounds the error of x_1. After a
stroke that erases the memory, this error is 0.

The motion of a free arm between two zeros narrows the range. With an extreme history the arm would
have moved away from x_1 by a known distance, and the actual distance is measured. The ratio of the
measured to the known distance limits which histories remain possible: those up to this fraction of
the way to the extreme history. Once the turning points are erased, only creep remains;
``unknown_creep`` bounds it for each creep time.
"""

from math import sqrt

from msgspec.structs import replace

from pincette.control.record import FrozenRecord
from pincette.control.response.free_response import FreeResponse, FreeSample
from pincette.control.response.unknown_creep import (
    Fallen,
    FreePlace,
    Spread,
    spread_of,
    widest_V,
)
from pincette.control.response.voltage_memory import VoltageMemory

RESTED_S = 86400.0
"""Duration of a rest after which creep has ended, in s. A history whose creep has ended differs
most from that of the model."""
ROOT_3 = sqrt(3.0)
SURE = 2.0
"""Tolerance of a comparison with a measurement, as a multiple of the standard uncertainty."""


class UnknownPast(FrozenRecord, frozen=True):
    """Free responses for the two extreme histories, updated as long as they matter."""

    lowest: FreeResponse
    """Free response for a history that rested at the lowest voltage."""
    highest: FreeResponse
    """Free response for a history that rested at the highest voltage."""
    ends_V: tuple[float, float]
    """Range that the voltage has not left, in V."""
    known: bool = False
    """True once the memory of the unknown history has been erased, or if there was none; the free
    responses are then no longer updated."""
    at_zero_um: tuple[float, float] = (0.0, 0.0)
    """Displacement for each extreme history minus that of the model, at the last zero, in µm."""
    shares: tuple[float, float] = (1.0, 1.0)
    """Upper bounds of the distance between the true history and the model's, as fractions of the
    distance from the model's history to each extreme history."""
    agreed_V: float | None = None
    """Voltage at which the free arm first rested with equal plays for all histories, in V; None
    before this rest."""
    met: FreePlace = FreePlace()
    """First rest after ``agreed_V`` with all plays reversed. From then on only creep remains of the
    unknown history."""
    creep_at_zero: Spread = Spread()
    fallen: Fallen = Fallen()
    """Decay of creep that was measured since ``met``."""

    @property
    def awaits_rest(self) -> bool:
        """Return whether ``met`` must still be determined from a rest of the free arm."""
        return not self.known and not self.met.spread.low_um

    def updated(self, voltage_V: float, dt_s: float) -> "UnknownPast":
        """Update both histories by a voltage that has been applied for ``dt_s``."""
        if self.known:
            return self
        return replace(
            self,
            lowest=self.lowest.updated(voltage_V, dt_s),
            highest=self.highest.updated(voltage_V, dt_s),
        )

    def replayed(self, memory: VoltageMemory) -> "UnknownPast":
        """Return both histories after all voltages since the start."""
        lowest, highest = memory.replayed(self.lowest), memory.replayed(self.highest)
        return replace(self, lowest=lowest, highest=highest)

    def rezero(self, response: FreeResponse) -> "UnknownPast":
        """Count errors from a zero at the present voltage, at which x_1 equals the position."""
        if self.known:
            return self
        at_um, spread = self.apart_um(response), self._spread(response)
        return replace(self, at_zero_um=at_um, creep_at_zero=spread)

    def rested(self, response: FreeResponse, rest: FreeSample, standard_um: float) -> "UnknownPast":
        """Evaluate a rest of the free arm, once the histories differ by creep alone.

        The first such rest is kept, and each later one is compared with it, with a tolerance of
        ``SURE`` standard uncertainties ``standard_um`` of x_1 between the two. The plays may agree
        before an arm with another class of hysteresis has lost its turning points. Therefore the
        voltage must first travel far enough to reverse the widest play, which takes the arm around
        its whole loop.
        """
        spread = Spread() if self.known else self._spread(response)
        if not spread.low_um:
            return self
        off_um = rest.x_um - rest.displacement_um
        if self.agreed_V is None:
            return replace(self, agreed_V=rest.voltage_V)
        if self.awaits_rest:
            if abs(rest.voltage_V - self.agreed_V) < widest_V(response):
                return self
            return replace(self, met=FreePlace(off_um, spread))
        fallen_um, allowed_um = self.met.off_um - off_um, SURE * standard_um
        each = spread.since(self.met.spread)
        return replace(self, fallen=Fallen(each, fallen_um - allowed_um, fallen_um + allowed_um))

    def compared(
        self, response: FreeResponse, residual_um: float, standard_um: float
    ) -> "UnknownPast":
        """Return the histories that agree with the measured deviation of a resting free arm from
        x_1.

        Parameters
        ----------
        response
            Model in use, after the same voltages.
        residual_um
            x - x_1.
        standard_um
            Standard uncertainty of x_1 for a known history. The tolerance is ``SURE`` times this
            value.
        """
        if self.known:
            return self
        lowest, highest = [
            min(share, _share(parted_um, residual_um, SURE * standard_um))
            for share, parted_um in zip(self.shares, self._parted_um(response), strict=True)
        ]
        return replace(self, shares=(lowest, highest))

    def error_um(self, response: FreeResponse) -> float:
        """Return the largest error of x_1 since the zero in µm.

            max_m a_m·|[y_m - y] - [y_m - y]_zero|

        with the displacement y of the model in use, y_m of each extreme history, and its fraction
        a_m; or the largest effect of creep, if that is less.
        """
        if self.known:
            return 0.0
        (lowest, highest), (lowest_um, highest_um) = self.shares, self._parted_um(response)
        error_um = max(lowest * abs(lowest_um), highest * abs(highest_um))
        if not (self.fallen.each.low_um and self.creep_at_zero.low_um):
            return error_um
        since_zero = self._spread(response).since(self.creep_at_zero)
        least_um, most_um = self.fallen.extremes_um(since_zero)
        return min(error_um, max(abs(least_um), abs(most_um)))

    def worst_um(self, response: FreeResponse) -> float:
        """Return the largest error after a zero now and a motion to any end of the range, in µm."""
        if self.known:
            return 0.0
        here, worst_um = self.updated(response.voltage_V, 0.0).rezero(response), 0.0
        for voltage_V in (response.voltage_V, *self.ends_V):
            for rest_s in (0.0, RESTED_S):
                led = here.updated(voltage_V, 0.0).updated(voltage_V, rest_s)
                model = response.updated(voltage_V, 0.0).updated(voltage_V, rest_s)
                worst_um = max(worst_um, led.error_um(model))
        return worst_um

    def matters(self, response: FreeResponse) -> bool:
        """Return whether the unknown history may cause more than the stated error over a stroke."""
        low_V, high_V = self.ends_V
        stroke = response.updated(low_V, 0.0).begin(0.0).updated(high_V, 0.0)
        return not self.known and self.worst_um(response) > stroke.error_um()

    def judged(self, response: FreeResponse) -> "UnknownPast":
        """Stop updating the histories once they no longer matter."""
        return self if self.matters(response) else replace(self, known=True)

    def _spread(self, response: FreeResponse) -> Spread:
        return spread_of(response, self.lowest, self.highest)

    def _parted_um(self, response: FreeResponse) -> tuple[float, float]:
        """Return by how much each difference of ``apart_um`` has changed since the zero, in µm."""
        lowest_um, highest_um = self.apart_um(response)
        return lowest_um - self.at_zero_um[0], highest_um - self.at_zero_um[1]

    def apart_um(self, response: FreeResponse) -> tuple[float, float]:
        """Return the displacement for each extreme history minus that of the model, in µm."""
        at_um = response.displacement_um()
        return self.lowest.displacement_um() - at_um, self.highest.displacement_um() - at_um


def unknown_past(response: FreeResponse, ends_V: tuple[float, float]) -> UnknownPast:
    """Return the histories of arms that rested at either end of a range.

    In both histories the next voltage is approached directly from that end.
    """
    lowest, highest = [response.updated(end_V, RESTED_S) for end_V in ends_V]
    return UnknownPast(lowest, highest, ends_V)


def _share(parted_um: float, residual_um: float, allowed_um: float) -> float:
    """Return the largest fraction of ``parted_um`` that residual and tolerance allow."""
    towards_um = residual_um if parted_um > 0.0 else -residual_um
    reach_um = max(0.0, towards_um) + allowed_um
    return 1.0 if reach_um >= abs(parted_um) else reach_um / abs(parted_um)


def standard_uncertainty_um(error_um: float) -> float:
    """Return the standard uncertainty of a quantity with a known bound (JCGM 100:2008, 4.3.7)."""
    return error_um / ROOT_3
