"""Strokes and contacts of a run, counted from its samples; pure."""

from collections.abc import Iterable
from itertools import pairwise

from pincette.api.results import ArmUse
from pincette.config import RigFile
from pincette.records.columns import Columns
from pincette_supervisor.plugin.result import PRESSED

STROKE_SHARE = 0.05
"""Smallest motion that counts as a stroke, as a share of the position range."""
POSITIONS = ("x_um", "second_x_um")
"""Columns of the position of each arm."""


def arm_use(table: Columns, rig: RigFile) -> ArmUse:
    """Return the use of the arm that made more strokes."""
    stroke_um = STROKE_SHARE * (rig.limits.position_max_um - rig.limits.position_min_um)
    times_s = table["t_s"]
    return ArmUse(
        strokes=max(strokes(table.get(name, ()), stroke_um) for name in POSITIONS),
        contacts=contacts(table["phase"], table["contact_x_um"]),
        duration_s=times_s[-1] - times_s[0] if times_s else 0.0,
    )


def strokes(x_um: Iterable[float | None], stroke_um: float) -> int:
    """Return the number of rises by at least ``stroke_um``, each between two falls by as much.

    Rises and falls that are smaller, such as noise, do not count. Missing values are left out.
    """
    count, rising = 0, False
    low_um, high_um = float("inf"), float("-inf")
    for x in x_um:
        if x is None:
            continue
        low_um, high_um = min(low_um, x), max(high_um, x)
        if not rising and x - low_um >= stroke_um:
            count, rising, high_um = count + 1, True, x
        elif rising and high_um - x >= stroke_um:
            rising, low_um = False, x
    return count


def contacts(phases: Iterable[str | None], places_um: Iterable[float | None]) -> int:
    """Return how often an arm that touched nothing met a part and pressed on it."""
    pressed = [
        phase in PRESSED and place_um is not None
        for phase, place_um in zip(phases, places_um, strict=True)
    ]
    return sum(now and not before for before, now in pairwise(pressed))
