"""Stability before motion: whether a law may run on a rig, judged at the worst it may meet.

The laws' backward differences do not see the arm's nearly undamped mode, so that a higher sampling
rate or another gain is no mere change of a parameter. What decides is the worst spectral radius of
the loop as it runs, over intervals of ω_n, K_e and delay.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import inf

import numpy as np

from pincette.control.force.observers import ForceObserver, QuasiStatic
from pincette.control.laws.definition import Array
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.loop_modes import counted_radii, settling_ticks
from pincette.control.stability.sampled_arm import LoopCase
from pincette.control.stability.worst_case import Intervals, worst_case

LIMIT_RADIUS = 0.97
"""A disturbance takes ln(0.02)/ln(0.97) = 128 ticks to fall to 2 %, 2.6 s at T = 20 ms, as long as
a grip takes to load: a slower loop still settles when the plan has gone on. It also leaves 3 % for
what the intervals do not hold, hysteresis and creep among it."""
ADVICE = 2
"""Most changes that a refusal proposes."""
NOTICEABLE = 0.01
"""By how much a switching term must raise the radius for a refusal to blame it."""
LONGEST_PERIOD_S = 0.05
"""Longest period that a refusal proposes."""


@dataclass(frozen=True, slots=True)
class Assessment:
    """The worst case of a loop, and whether it is good enough to move."""

    radius: float
    """Spectral radius, one tick to the next."""
    limit_radius: float
    case: LoopCase
    """Where it occurs."""
    settling_s: float
    """Until a disturbance has fallen to 2 % in that case; infinite where it does not."""
    reason: str
    """Why the loop must not run, and what to change; "" where it may."""

    @property
    def stable(self) -> bool:
        """Whether the loop may run."""
        return self.radius < self.limit_radius


def assess(loop: Loop, intervals: Intervals, limit_radius: float = LIMIT_RADIUS) -> Assessment:
    """Judge a loop by its worst case.

    The search for the worst case is a grid and a climb from its highest points (``worst_case``):
    what it gives is reached, and a dense search finds at most some 0.01 more.

    Raises
    ------
    ValueError
        Where the limit is not between 0 and 1, or the law cannot be made.
    """
    if not 0.0 < limit_radius < 1.0:
        raise ValueError(f"limit of the spectral radius = {limit_radius}, must be between 0 and 1")
    case, radius = worst_case(loop, intervals, limit_radius)
    if 0.0 < radius < 1.0:
        settling_s = settling_ticks(radius) * loop.period_s
    else:
        settling_s = inf if radius > 0.0 else 0.0
    reason = ""
    if not radius < limit_radius:
        reason = _reason(loop, intervals, limit_radius, case, radius)
    return Assessment(radius, limit_radius, case, settling_s, reason)


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
            other = replace(loop, period_s=period_s, observer=observer).with_gains(**{gain: value})
            if worst:
                found[row, column] = worst_case(other, intervals, LIMIT_RADIUS)[1]
            else:
                radii = counted_radii(other, intervals.middle(), LIMIT_RADIUS)
                found[row, column] = np.max(radii)
    return found


def describe(loop: Loop, case: LoopCase) -> str:
    """Name a case in words: free or in contact, ω_n, delay."""
    contact = f"in contact with K_e = {case.K_e_mN_per_um:.3g} mN/µm"
    omega_n = (loop.arm.k / loop.arm.m) ** 0.5 * case.frequency_factor
    delay_ms = 1e3 * case.delay_periods * loop.period_s
    slope = ""
    if case.gain_factor != 1.0:
        slope = f", free response {100.0 * (case.gain_factor - 1.0):+.0f} % steeper than its model"
    return (
        f"{contact if case.K_e_mN_per_um > 0.0 else 'free'}, "
        f"ω_n = {omega_n:.0f} rad/s, delay = {delay_ms:.2g} ms{slope}"
    )


def _reason(
    loop: Loop, intervals: Intervals, limit_radius: float, case: LoopCase, radius: float
) -> str:
    fault = "is unstable" if radius >= 1.0 else "settles too slowly"
    advice = ", ".join(islice(_advice(loop, intervals, limit_radius, case), ADVICE))
    return (
        f"the loop {fault}: spectral radius {radius:.4g}, limit {limit_radius:.4g}, at a period "
        f"of {1e3 * loop.period_s:g} ms, {describe(loop, case)}; "
        f"{advice or 'no change of one gain or of the period that was tried suffices'}"
    )


def _advice(loop: Loop, intervals: Intervals, limit_radius: float, case: LoopCase) -> Iterator[str]:
    """Name changes that suffice in every case, the gentlest of each family."""

    def here(other: Loop) -> float:
        return float(counted_radii(other, (case,), limit_radius)[0])

    def reached(other: Loop) -> float:
        # Most changes fail in the very case that calls for one; the search is for the rest.
        radius = here(other)
        return radius if radius >= limit_radius else worst_case(other, intervals, limit_radius)[1]

    before = ""
    if loop.law.switches:
        switching = loop.law.definition.switching
        silent = loop.with_gains(**{switching: 0.0})
        if here(silent) < here(loop) - NOTICEABLE:
            radius = reached(silent)
            if radius < limit_radius:
                yield f"{switching} = 0 gives {radius:.3f}"
                return
            loop, before = silent, f"{switching} = 0 and "
    for family in _families(loop):
        for text, other in family:
            radius = reached(other)
            if radius < limit_radius:
                yield f"{before}{text} gives {radius:.3f}"
                break


def _families(loop: Loop) -> Iterator[list[tuple[str, Loop]]]:
    """Changes of one thing each, the gentlest first."""
    remedies = loop.law.definition.remedies
    for name, values in remedies(loop.law.gains) if remedies is not None else ():
        yield [(f"{name} = {value:.4g}", loop.with_gains(**{name: value})) for value in values]
    # Any other observer is made for its period.
    if loop.observer is None or (
        isinstance(loop.observer, QuasiStatic) and loop.observer.parameters.share == 1.0
    ):
        periods = [loop.period_s * factor for factor in (1.25, 1.6, 2.0, 3.0, 5.0, 10.0, 20.0)]
        yield [
            (f"a period of {1e3 * period_s:.3g} ms", replace(loop, period_s=period_s))
            for period_s in periods
            if period_s <= LONGEST_PERIOD_S
        ]
