"""The free response x_1 from a recorded stroke up and down, by Madelung's rules.

The two branches are stored as normalised shapes: the fraction of the travel in x as a function of
the fraction of the travel in u. From a turning point (u_r, x_r) the arm moves towards the previous
turning point (u_p, x_p) by

    x = x_r + (x_p - x_r)·shape((u - u_r)/(u_p - u_r))

with the shape of the branch in that direction. Once it has passed (u_p, x_p), the loop between the
two is erased and the branch before it continues (return-point memory). Source: E. Madelung, Annalen
der Physik 322(10), 1905. Creep is not modelled, and adds to the error.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from msgspec.structs import replace

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.response.free_response import MemoryResponse

MOST_TURNS = 16
"""Largest number of turning points kept; with more, the smallest loop is discarded."""
IGNORED_V = 0.01
"""Largest reversal, in V, that is attributed to noise and returns on the same branch."""


class Turn(NamedTuple):
    """A turning point of the voltage."""

    voltage_V: float
    x_um: float


@dataclass(frozen=True, slots=True)
class RecordedBranches:
    """The outermost loop, and its branches at evenly spaced fractions of the voltage travel.

    Raises
    ------
    ValueError
        If the loop does not rise in u and in x, or a shape does not rise from 0 to 1.
    """

    bottom: Turn
    top: Turn
    ascending: tuple[float, ...]
    """Fractions of the travel in x from bottom to top."""
    descending: tuple[float, ...]
    """Fractions of the travel in x from top to bottom."""

    def __post_init__(self) -> None:
        require_positive("voltage of the stroke", self.top.voltage_V - self.bottom.voltage_V, "V")
        require_positive("height of the stroke", self.top.x_um - self.bottom.x_um, "µm")
        for name, shape in (("ascending", self.ascending), ("descending", self.descending)):
            if len(shape) < 2 or shape[0] != 0.0 or shape[-1] != 1.0:
                raise ValueError(f"{name} shape of {len(shape)} values, must go from 0 to 1")
            for before, after in pairwise(shape):
                require_positive(f"rise of the {name} shape", after - before, "")


class RecordedResponse(MemoryResponse, frozen=True):
    """x_1 = offset + displacement on the recorded branches."""

    branches: RecordedBranches
    turns: tuple[Turn, ...]
    """Turning points, oldest first, at least two. The arm moves from the last one towards the one
    before it."""
    furthest_V: float
    """Voltage furthest from the last turning point that was reached since that turning point,
    in V."""
    voltage_V: float
    """Newest voltage, in V."""

    def updated(self, voltage_V: float, _dt_s: float, /) -> "RecordedResponse":
        """Update the response by the voltage; the branches do not depend on time."""
        turns, furthest_V, u = self.turns, self.furthest_V, voltage_V
        rising = turns[-2].voltage_V > turns[-1].voltage_V
        if abs(u - furthest_V) > IGNORED_V and (u < furthest_V) == rising:
            turns = _turned(self.branches, turns, furthest_V)
            furthest_V, rising = u, not rising
        if (u > furthest_V) == rising:
            furthest_V = u
        turns = _passed(self.branches, turns, furthest_V)
        return replace(self, turns=turns, furthest_V=furthest_V, voltage_V=u)

    def displacement_um(self) -> float:
        """Return the position on the branch at the newest voltage, without offset, in µm."""
        return _on_branch(self.branches, self.turns[-1], self.turns[-2], self.voltage_V)

    def _voltage_V(self) -> float:
        return self.voltage_V


def recorded_response(
    branches: RecordedBranches, piezo_um_per_V: float, model_error_um: float
) -> RecordedResponse:
    """Return the response at 0 V on the ascending branch; raises ValueError for impossible numbers.

    The history of the arm is unknown. The first stroke to an end of the recorded range makes it
    irrelevant.
    """
    turns = _passed(branches, (branches.top, branches.bottom), 0.0)
    if branches.bottom.voltage_V > 0.0:
        turns = (branches.top, _on_line(branches, branches.bottom, 0.0))
    return RecordedResponse(
        branches=branches,
        turns=turns,
        furthest_V=0.0,
        voltage_V=0.0,
        nominal_um_per_V=require_positive("piezoelectric constant", piezo_um_per_V, "µm/V"),
        model_error_um=require_not_negative("model error", model_error_um, "µm"),
    )


def _turned(branches: RecordedBranches, turns: tuple[Turn, ...], at_V: float) -> tuple[Turn, ...]:
    """Return the turning points after the voltage reversed at ``at_V``."""
    here = Turn(at_V, _on_branch(branches, turns[-1], turns[-2], at_V))
    if len(turns) == 2 and at_V == turns[0].voltage_V:
        return turns[1], here
    turns = (*turns, here)
    if len(turns) <= MOST_TURNS:
        return turns
    # Find the smallest loop between two successive turns, except the outermost loop and the branch
    # in use.
    smallest = min(
        range(1, len(turns) - 3),
        key=lambda index: abs(turns[index + 1].voltage_V - turns[index].voltage_V),
    )
    return turns[:smallest] + turns[smallest + 2 :]


def _passed(branches: RecordedBranches, turns: tuple[Turn, ...], at_V: float) -> tuple[Turn, ...]:
    """Return the turning points after the voltage has moved to ``at_V`` on its branch."""
    while True:
        origin, target = turns[-1], turns[-2]
        rising = target.voltage_V > origin.voltage_V
        if at_V == target.voltage_V or (at_V < target.voltage_V) == rising:
            return turns
        if len(turns) == 2:
            # Beyond the recorded range the branch continues as a straight line.
            return _on_line(branches, target, at_V), origin
        turns = (turns[1], turns[0]) if len(turns) == 3 else turns[:-2]


def _on_line(branches: RecordedBranches, end: Turn, at_V: float) -> Turn:
    """Return a point on the line through a loop's end with the mean slope of the loop."""
    bottom, top = branches.bottom, branches.top
    slope = (top.x_um - bottom.x_um) / (top.voltage_V - bottom.voltage_V)
    return Turn(at_V, end.x_um + slope * (at_V - end.voltage_V))


def _on_branch(branches: RecordedBranches, origin: Turn, target: Turn, at_V: float) -> float:
    """Return the position on the branch from one turning point towards another, in µm."""
    shape = branches.ascending if target.voltage_V > origin.voltage_V else branches.descending
    cells = len(shape) - 1
    place = cells * (at_V - origin.voltage_V) / (target.voltage_V - origin.voltage_V)
    cell = min(max(int(place), 0), cells - 1)
    share = shape[cell] + (place - cell) * (shape[cell + 1] - shape[cell])
    return origin.x_um + (target.x_um - origin.x_um) * share
