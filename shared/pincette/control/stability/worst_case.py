"""The worst case of a loop: the largest spectral radius over intervals of what is not known.

The arm's mode is nearly undamped, so that where it lies against the sampling decides: the radius
has peaks, narrow in the phases ω·T and ω·delay. A grid that follows the phases finds their
feet, and a search from its highest points climbs them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from math import ceil, inf, sqrt

import numpy as np

from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.loop_modes import counted_radii
from pincette.control.stability.sampled_arm import LoopCase

Axis = tuple[float, ...]
Axes = tuple[Axis, Axis, Axis, Axis]

PHASE = 0.4
"""Spacing of the grid in rad of the mode."""
POINTS = 17
"""Most points of the grid along one quantity; the mode is well damped where more were wanted."""
STIFFNESSES = 7
GAINS = 3
CLIMBS = 8
"""Points from which to climb, of the free arm and of the arm in contact, and"""
HALVINGS = 7
"""how often the step is halved."""


@dataclass(frozen=True, slots=True)
class Intervals:
    """What is not known of the rig, from the least to the largest.

    Raises
    ------
    ValueError
        Where an interval is upside down, or a value in it impossible.
    """

    K_e_mN_per_um: tuple[float, float] | None
    """Of the contact; None where nothing is touched."""
    free: bool = True
    """Whether the arm also moves free."""
    frequency_factor: tuple[float, float] = (0.95, 1.05)
    """Of ω_n, over the identified one."""
    delay_periods: tuple[float, float] = (0.0, 0.5)
    """Of the delay from the sample to the new voltage."""
    gain_factor: tuple[float, float] = (1.0, 1.0)
    """Of the slope of the free response, over that which the law takes it to have."""

    def __post_init__(self) -> None:
        if self.K_e_mN_per_um is None and not self.free:
            raise ValueError("no case: the arm is neither free nor in contact")
        for name in ("K_e_mN_per_um", "frequency_factor", "delay_periods", "gain_factor"):
            interval: tuple[float, float] | None = getattr(self, name)
            if interval is not None and not interval[0] <= interval[1]:
                raise ValueError(f"{name}: from {interval[0]} to {interval[1]}, must be ascending")
        # A case refuses what is impossible in itself.
        for values in product(
            self.K_e_mN_per_um or (0.0,),
            self.frequency_factor,
            self.delay_periods,
            self.gain_factor,
        ):
            LoopCase(*values)

    def middle(self) -> tuple[LoopCase, ...]:
        """Return the cases in the middle: free, and in contact."""
        factor, delay = _middle(self.frequency_factor), _middle(self.delay_periods)
        gain = _middle(self.gain_factor)
        stiffness = [0.0] if self.free else []
        if self.K_e_mN_per_um is not None:
            stiffness.append(_middle(self.K_e_mN_per_um))
        return tuple(LoopCase(K_e, factor, delay, gain) for K_e in stiffness)


def around(
    stiffness_mN_per_um: float,
    tolerance: float,
    delay_periods: tuple[float, float] = (0.0, 0.5),
    gain_factor: tuple[float, float] = (1.0, 1.0),
) -> Intervals:
    """Intervals for a part whose stiffness is known to a relative tolerance below 1."""
    least, largest = 1.0 - tolerance, 1.0 + tolerance
    return Intervals(
        (stiffness_mN_per_um * least, stiffness_mN_per_um * largest),
        delay_periods=delay_periods,
        gain_factor=gain_factor,
    )


@lru_cache(maxsize=1024)
def worst_case(
    loop: Loop, intervals: Intervals, limit_radius: float, *, enough: float = inf
) -> tuple[LoopCase, float]:
    """Find the case of the largest counted radius, and that radius.

    Parameters
    ----------
    enough
        The search ends with the first case found that reaches this radius, though another may be
        worse: all that a refusal wants.
    """
    tops: list[tuple[LoopCase, float]] = []
    for kind in _kinds(intervals):
        tops.append(_worst_of(loop, kind, limit_radius, enough))
        if tops[-1][1] >= enough:
            break
    return max(tops, key=lambda one: one[1])


def _kinds(intervals: Intervals) -> Iterator[Intervals]:
    """The free arm and the arm in contact, which are two loops."""
    if intervals.free:
        yield replace(intervals, K_e_mN_per_um=None)
    if intervals.K_e_mN_per_um is not None:
        yield replace(intervals, free=False)


def _worst_of(
    loop: Loop, kind: Intervals, limit_radius: float, enough: float
) -> tuple[LoopCase, float]:
    axes = _axes(loop, kind)
    cases = tuple(LoopCase(*values) for values in product(*axes))
    radii = counted_radii(loop, cases, limit_radius)
    found = zip(cases, map(float, radii), strict=True)
    tops = sorted(found, key=lambda one: -one[1])[:CLIMBS]
    share = 0.5
    for _ in range(HALVINGS):
        if max(radius for _, radius in tops) >= enough:
            break
        neighbours = [_neighbours(axes, case, share) for case, _ in tops]
        flat = tuple(case for some in neighbours for case in some)
        if not flat:
            break
        all_radii = counted_radii(loop, flat, limit_radius).reshape(len(tops), -1)
        for index, radii in enumerate(all_radii):
            best = int(np.argmax(radii))
            if radii[best] > tops[index][1]:
                tops[index] = (neighbours[index][best], float(radii[best]))
        share *= 0.5
    return max(tops, key=lambda one: one[1])


def _axes(loop: Loop, kind: Intervals) -> Axes:
    """Values of K_e, of the frequency factor, the delay and the gain factor that make the grid."""
    stiffness = kind.K_e_mN_per_um or (0.0, 0.0)
    # Of the mode over a period, where the contact is stiffest.
    phase = sqrt((loop.arm.k + stiffness[1]) / loop.arm.m) * loop.period_s
    return (
        _spaced(stiffness, STIFFNESSES),
        _spaced(kind.frequency_factor, _points(kind.frequency_factor, phase)),
        _spaced(kind.delay_periods, _points(kind.delay_periods, phase)),
        _spaced(kind.gain_factor, GAINS),
    )


def _points(interval: tuple[float, float], phase: float) -> int:
    return min(POINTS, max(3, 1 + ceil((interval[1] - interval[0]) * phase / PHASE)))


def _spaced(interval: tuple[float, float], points: int) -> Axis:
    if interval[0] == interval[1]:
        return (interval[0],)
    return tuple(float(value) for value in np.linspace(interval[0], interval[1], points))


def _neighbours(axes: Axes, case: LoopCase, share: float) -> list[LoopCase]:
    """Two cases along each quantity, a share of the grid's spacing away, within the intervals."""
    place = (case.K_e_mN_per_um, case.frequency_factor, case.delay_periods, case.gain_factor)
    found: list[LoopCase] = []
    for index, axis in enumerate(axes):
        least, largest = min(axis), max(axis)
        if least == largest:
            continue
        spacing = (largest - least) / max(1, len(axis) - 1)
        for step in (-share * spacing, share * spacing):
            moved = list(place)
            moved[index] = min(largest, max(least, place[index] + step))
            found.append(LoopCase(*moved))
    return found


def _middle(interval: tuple[float, float]) -> float:
    return 0.5 * (interval[0] + interval[1])
