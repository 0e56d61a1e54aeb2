"""Stability before motion: whether a law may run on a rig, judged by its worst case.

The laws' backward differences ignore the arm's nearly undamped mode, so that another sampling rate
or gain may make the loop unstable. The criterion is the worst spectral radius of the loop as it
runs, over intervals of ω_n, K_e and delay.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.force.observers import ForceObserver
from pincette.control.laws.definition import Array
from pincette.control.stability.limits import LIMIT_PEAK, limit_radius_at, short, widened
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.loop_modes import counted_radii, settling_ticks
from pincette.control.stability.refusal import reason
from pincette.control.stability.worst_case import Intervals, worst_case, worst_sensitivity


@dataclass(frozen=True, slots=True)
class Assessment:
    """The worst case of a loop, and whether the loop may run."""

    radius: float
    """Spectral radius from one tick to the next."""
    limit_radius: float
    case: LoopCase
    """Case with this radius."""
    settling_s: float
    """Time in which a disturbance decays to 2 % in the worst case, in s; infinite if it does not
    decay."""
    reason: str
    """Reason why the loop must not run, and what to change; "" if it may run."""
    sensitivity_peak: float
    """Worst peak M_s; infinite for an unstable loop."""
    limit_peak: float
    """Limit of the peak M_s; infinite if the period is long compared with that of the mode."""

    @property
    def stable(self) -> bool:
        """True if the loop may run."""
        return self.radius < self.limit_radius and self.sensitivity_peak <= self.limit_peak


def assess(loop: Loop, intervals: Intervals) -> Assessment:
    """Assess a loop by its worst case over the intervals, ``widened`` at a short period.

    The search for the worst case is a grid and a climb from its highest points (``worst_case``):
    the resulting radius does occur, and a dense search finds a radius that is larger by at most
    about 0.01. M_s is computed at the ends and in the middle of each interval.

    Raises
    ------
    ValueError
        If the law cannot be built.
    """
    limit_radius = limit_radius_at(loop.period_s)
    met = widened(loop, intervals)
    case, radius = worst_case(loop, met, limit_radius)
    limit_peak = LIMIT_PEAK if short(loop) else inf
    peak_case, peak = (case, inf) if radius >= 1.0 else worst_sensitivity(loop, met)
    if 0.0 < radius < 1.0:
        settling_s = settling_ticks(radius) * loop.period_s
    else:
        settling_s = inf if radius > 0.0 else 0.0
    why = ""
    if not radius < limit_radius:
        fault = "is unstable" if radius >= 1.0 else "settles too slowly"
        fault += f": spectral radius {radius:.4g}, limit {limit_radius:.4g}"
        why = reason(loop, intervals, fault, case, by_radius=True)
    elif not peak <= limit_peak:
        fault = f"is too near to instability: peak of sensitivity {peak:.3g}, limit {limit_peak:g}"
        case, why = peak_case, reason(loop, intervals, fault, peak_case, by_radius=False)
    return Assessment(radius, limit_radius, case, settling_s, why, peak, limit_peak)


def radius_map(
    loop: Loop,
    intervals: Intervals,
    *,
    periods_s: Sequence[float],
    gains: Sequence[float],
    gain: str = "K_P",
    worst: bool = True,
    observer_at: Callable[[float], ForceObserver] | None = None,
) -> Array:
    """Return the spectral radius over period and gain, shape (periods, gains).

    Parameters
    ----------
    loop
        Loop with all other properties; its own period and gain do not matter.
    worst
        True for the worst case of the intervals (about 20 to 100 ms per point); False for the worse
        one of the middle cases, free and in contact.
    observer_at
        Function that returns the observer for a period; without it the loop's observer is used for
        all.

    Raises
    ------
    ValueError
        If a period is not positive or a gain negative.
    """
    found = np.empty((len(periods_s), len(gains)))
    for row, period_s in enumerate(periods_s):
        observer = loop.observer if observer_at is None else observer_at(period_s)
        for column, value in enumerate(gains):
            other = replace(loop, period_s=period_s, observer=observer).with_gains(**{gain: value})
            if worst:
                limit = limit_radius_at(period_s)
                found[row, column] = worst_case(other, widened(other, intervals), limit)[1]
            else:
                radii = counted_radii(other, intervals.middle(), limit_radius_at(period_s))
                found[row, column] = np.max(radii)
    return found
