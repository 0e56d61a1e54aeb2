"""How far a loop is from its limit: gain margin, and radius over period and gain."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pincette.control.force.observers import ForceObserver
from pincette.control.stability.assessment import LIMIT_RADIUS
from pincette.control.stability.loop_blocks import Array
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.loop_modes import counted_radii
from pincette.control.stability.sampled_arm import LoopCase
from pincette.control.stability.worst_case import Intervals, worst_case

FARTHEST = 32.0
"""Factor beyond which no margin is looked for."""
STEPS = 80
"""Of the first pass up to it, 4.4 % each."""


@dataclass(frozen=True, slots=True)
class GainMargin:
    """Factors on the real d_p between which the loop stays stable."""

    lowest: float
    """1/32 where none was found; 1 where the loop is unstable as it is."""
    highest: float
    """32 where none was found; 1 where the loop is unstable as it is."""


def gain_margin(loop: Loop, cases: tuple[LoopCase, ...]) -> GainMargin:
    """Find how far the real d_p may be off the identified one, both ways, with r < 1 in all cases.

    The law and the estimator keep the identified d_p, so that the force is misread along with it.
    The cases' own factors are multiplied by it. Margins end at the first factor that is unstable.
    """
    if _radius(loop, cases, 1.0) >= 1.0:
        return GainMargin(1.0, 1.0)
    return GainMargin(_end(loop, cases, 1.0 / FARTHEST), _end(loop, cases, FARTHEST))


def _end(loop: Loop, cases: tuple[LoopCase, ...], farthest: float) -> float:
    inside = 1.0
    for outside in np.geomspace(1.0, farthest, STEPS)[1:]:
        if _radius(loop, cases, float(outside)) >= 1.0:
            break
        inside = float(outside)
    else:
        return farthest
    beyond = float(outside)
    while abs(beyond - inside) > 1e-4 * inside:
        between = 0.5 * (inside + beyond)
        if _radius(loop, cases, between) >= 1.0:
            beyond = between
        else:
            inside = between
    return inside


def _radius(loop: Loop, cases: tuple[LoopCase, ...], factor: float) -> float:
    scaled = tuple(replace(case, gain_factor=case.gain_factor * factor) for case in cases)
    return float(np.max(counted_radii(loop, scaled, LIMIT_RADIUS)))


def radius_map(
    loop: Loop,
    intervals: Intervals,
    *,
    periods_s: Sequence[float],
    gains: Sequence[float],
    gain: Literal["K_P", "K_f"] = "K_P",
    worst: bool = True,
    observer_at: Callable[[float], ForceObserver] | None = None,
) -> Array:
    """Spectral radius over period and gain, shape (periods, gains).

    Parameters
    ----------
    loop
        Everything else; its own period and gain do not matter.
    worst
        The worst case of the intervals (some 20 to 100 ms a point), or else the worse of the
        cases in the middle, free and in contact.
    observer_at
        Makes the observer for a period; without it the loop's is taken for every one.

    Raises
    ------
    ValueError
        Where a period is not positive or a gain negative.
    """
    found = np.empty((len(periods_s), len(gains)))
    for row, period_s in enumerate(periods_s):
        observer = loop.observer if observer_at is None else observer_at(period_s)
        for column, value in enumerate(gains):
            other = replace(loop, period_s=period_s, observer=observer).with_law(**{gain: value})
            if worst:
                found[row, column] = worst_case(other, intervals, LIMIT_RADIUS)[1]
            else:
                radii = counted_radii(other, intervals.middle(), LIMIT_RADIUS)
                found[row, column] = np.max(radii)
    return found
