"""Residual of the free response model along one program, by segment and tick.

    r_k = (x_k - H_k) - mean over the last zero

with the position x of the free arm, the displacement H of the model, and a tick k of the program.
Since the program repeats the same voltages, most of r repeats too: F̂ = (offset + H + r - x)/s_p.
"""

from dataclasses import dataclass
from typing import NamedTuple

from pincette.control.checks import require_not_negative

MOST_KNOTS = 2400
"""Largest number of knots of a table, which is sent with the model when the rig is armed."""


class Residual(NamedTuple):
    """Residual at one tick."""

    value_um: float
    beyond: int
    """Number of ticks past the last played tick of the segment, where the last value is used."""


@dataclass(frozen=True, slots=True)
class ResidualTable:
    """Residuals r in µm at every ``stride``-th tick of each segment, linear in between.

    Raises
    ------
    ValueError
        If stride or error are impossible, or the knots are too many.
    """

    stride: int
    """Number of ticks from one knot to the next."""
    knots_um: tuple[tuple[float, ...], ...]
    """Knots of each segment of the program, in µm. The first knot of a segment is at its tick 0. A
    segment that was not played has no knots."""
    error_um: float
    """Standard error of r in a later run, in µm."""

    def __post_init__(self) -> None:
        if self.stride < 1:
            raise ValueError(f"stride = {self.stride} ticks, must be at least 1")
        require_not_negative("error of the residual", self.error_um, "µm")
        count = sum(len(knots) for knots in self.knots_um)
        if count > MOST_KNOTS:
            raise ValueError(f"{count} knots, limit {MOST_KNOTS}: choose a longer stride")

    def at(self, segment: int, tick: int) -> Residual | None:
        """Return r at a tick of a segment; None if the segment was not played."""
        if not 0 <= segment < len(self.knots_um) or tick < 0:
            return None
        knots = self.knots_um[segment]
        if not knots:
            return None
        place, past = divmod(tick, self.stride)
        if place + 1 >= len(knots):
            return Residual(knots[-1], tick - (len(knots) - 1) * self.stride)
        share = past / self.stride
        return Residual(knots[place] + share * (knots[place + 1] - knots[place]), 0)
