"""Unknown creep of an arm whose turning points are known, and bounds on it from free motion.

Histories after which the plays have the same states differ by creep alone. Each difference decays
separately, with the time constant of its creep state, whatever the voltage does:

    D_j(t) = κ_j·[c_j(t) - c_j,model(t)] = D_j(0)·e^(-t/τ_j),    low_j ≤ D_j ≤ high_j

Between two rests, a free arm deviates from the model by Σ_j [D_j(t_2) - D_j(t_1)], within the error
of x_1. This measurement bounds the effect of the same D_j on x_1 after a zero. The extremes of one
sum of the D_j, subject to bounds on another sum, are a linear program with box constraints and one
row, which is solved by taking the D_j in the order of their ratios (G. B. Dantzig, Operations
Research 5(2), 1957). Creep times are treated separately, since fast creep that has ended gives no
information about slow creep.
"""

from collections.abc import Sequence

from pincette.control.record import FrozenRecord
from pincette.control.response.free_response import FreeResponse
from pincette.control.response.identified_response import IdentifiedResponse

TOGETHER_UM = 0.02
"""Largest difference of displacement, in µm, for which the plays of two histories count as
equal."""


class Spread(FrozenRecord, frozen=True):
    """Bounds of each D_j, in µm; empty if the bounds are not known."""

    low_um: tuple[float, ...] = ()
    high_um: tuple[float, ...] = ()

    def since(self, before: "Spread") -> "Spread":
        """Return by how much the bounds of each D_j have decayed since ``before``."""
        return Spread(
            tuple([b - a for a, b in zip(self.low_um, before.low_um, strict=True)]),
            tuple([b - a for a, b in zip(self.high_um, before.high_um, strict=True)]),
        )


class FreePlace(FrozenRecord, frozen=True):
    """Position at which an arm was found free and at rest."""

    off_um: float = 0.0
    """Position minus the model's displacement, in µm."""
    spread: Spread = Spread()


class Fallen(FrozenRecord, frozen=True):
    """Decay between two free rests, of each D_j and of their sum."""

    each: Spread = Spread()
    least_um: float = 0.0
    """Lower bound of the decay of the sum, in µm."""
    most_um: float = 0.0

    def extremes_um(self, since_zero: Spread) -> tuple[float, float]:
        """Return the smallest and largest decay of the sum of the same D_j since a zero."""
        rows = [
            (min(a, b), abs(b - a), min(c, d), abs(d - c))
            for a, b, c, d in zip(
                self.each.low_um,
                self.each.high_um,
                since_zero.low_um,
                since_zero.high_um,
                strict=True,
            )
        ]
        from_um, least_um = sum(row[0] for row in rows), sum(row[2] for row in rows)
        spans = [(span_um, gain_um) for _, span_um, _, gain_um in rows]
        whole_um, gain_um = sum(span for span, _ in spans), sum(gain for _, gain in spans)
        most_um = _most(spans, self.most_um - from_um)
        left_um = _most(spans, whole_um - (self.least_um - from_um))
        return least_um + gain_um - left_um, least_um + most_um


def _most(spans: Sequence[tuple[float, float]], room_um: float) -> float:
    """Return the largest Σ f_j·gain_j with 0 ≤ f_j ≤ 1 and Σ f_j·span_j ≤ room."""
    total_um, room_um = 0.0, max(0.0, room_um)
    for span_um, gain_um in sorted(spans, key=_ratio, reverse=True):
        share = 1.0 if span_um <= room_um else room_um / span_um
        total_um += share * gain_um
        room_um -= share * span_um
    return total_um


def _ratio(span: tuple[float, float]) -> float:
    span_um, gain_um = span
    return gain_um / span_um if span_um > 0.0 else float("inf")


def spread_of(response: FreeResponse, lowest: FreeResponse, highest: FreeResponse) -> Spread:
    """Return the bounds of D_j by the extreme histories; empty if their plays still differ."""
    if not (
        isinstance(response, IdentifiedResponse)
        and isinstance(lowest, IdentifiedResponse)
        and isinstance(highest, IdentifiedResponse)
    ):
        return Spread()
    at, low, high = response.memory, lowest.memory, highest.memory
    weights = response.model.weights_um_per_V
    apart_um = 0.0
    for w, a, b, c in zip(weights, at.plays_V, low.plays_V, high.plays_V, strict=True):
        apart_um += abs(w) * (abs(b - a) + abs(c - a))
    if apart_um > TOGETHER_UM:
        return Spread()
    fractions = response.model.creep_fractions
    return Spread(
        tuple([k * (b - a) for k, a, b in zip(fractions, at.creep_um, low.creep_um, strict=True)]),
        tuple([k * (b - a) for k, a, b in zip(fractions, at.creep_um, high.creep_um, strict=True)]),
    )


def widest_V(response: FreeResponse) -> float:
    """Return the voltage travel that reverses every play, in V; 0 without plays."""
    if not isinstance(response, IdentifiedResponse):
        return 0.0
    return 2.0 * max(response.model.thresholds_V)
