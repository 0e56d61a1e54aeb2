"""Stability before motion: whether a law may run on a rig, judged at the worst it may meet.

The laws' backward differences do not see the arm's nearly undamped mode, so that a higher sampling
rate or another gain is no mere change of a parameter. What decides is the worst spectral radius of
the loop as it runs, over intervals of ω_n, K_e and delay.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from math import inf

from pincette.control.force.observers import QuasiStatic
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

    @property
    def margin(self) -> float:
        """Limit minus radius."""
        return self.limit_radius - self.radius


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


def describe(loop: Loop, case: LoopCase) -> str:
    """Name a case in words: free or in contact, ω_n, delay."""
    contact = f"in contact with K_e = {case.K_e_mN_per_um:.3g} mN/µm"
    omega_n = (loop.arm.k / loop.arm.m) ** 0.5 * case.frequency_factor
    delay_ms = 1e3 * case.delay_periods * loop.period_s
    return (
        f"{contact if case.K_e_mN_per_um > 0.0 else 'free'}, "
        f"ω_n = {omega_n:.0f} rad/s, delay = {delay_ms:.2g} ms"
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
    if loop.law.K_S > 0.0:
        silent = loop.with_law(K_S=0.0)
        if here(silent) < here(loop) - NOTICEABLE:
            radius = reached(silent)
            if radius < limit_radius:
                yield f"K_S = 0 gives {radius:.3f}"
                return
            loop, before = silent, "K_S = 0 and "
    for family in _families(loop):
        for text, other in family:
            radius = reached(other)
            if radius < limit_radius:
                yield f"{before}{text} gives {radius:.3f}"
                break


def _families(loop: Loop) -> Iterator[list[tuple[str, Loop]]]:
    """Changes of one thing each, the gentlest first."""
    law = loop.law
    gains = [(law.K_P or law.K_I) * factor for factor in (2.0, 0.5, 5.0, 0.2)]
    yield [(f"K_P = {K_P:.3g}", loop.with_law(K_P=K_P)) for K_P in gains]
    gains = [law.K_f * factor for factor in (0.5, 0.1) if law.K_f > 0.0]
    yield [(f"K_f = {K_f:.4g}", loop.with_law(K_f=K_f)) for K_f in gains]
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
