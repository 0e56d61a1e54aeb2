"""The worst case of a loop: its largest spectral radius over intervals of unknown properties.

The arm's mode is nearly undamped, so that its frequency relative to the sampling rate is decisive:
the radius has narrow peaks over the phases ω·T and ω·delay. A grid with spacing in these phases
finds a point near each peak, and a local search from the highest points finds the maximum.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from math import ceil, inf, sqrt

import numpy as np

from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.loop_modes import counted_radii
from pincette.control.stability.sensitivity import sensitivity_peaks

Axis = tuple[float, ...]
Axes = tuple[Axis, Axis, Axis, Axis, Axis]

PHASE = 0.4
"""Spacing of the grid, in rad of the mode."""
POINTS = 17
"""Largest number of grid points along one quantity. If more were needed, the mode would be well
damped."""
STIFFNESSES = 7
GAINS = 3
WIDE_STIFFNESSES = 4
"""Number of stiffnesses if every interval is wide; only the ends of the gain are then used."""
NAMES = ("K_e_mN_per_um", "frequency_factor", "delay_periods", "gain_factor", "damping_factor")
CLIMBS = 8
"""Number of points from which a local search begins, for the free arm and for the arm in
contact."""
HALVINGS = 7
"""Number of times that the step of a local search is halved."""


@dataclass(frozen=True, slots=True)
class Intervals:
    """Intervals of unknown properties of the rig, each from the smallest to the largest value.

    Raises
    ------
    ValueError
        If an interval is not ascending, or a value in it impossible.
    """

    K_e_mN_per_um: tuple[float, float] | None
    """Stiffness of the contact, in mN/µm; None if the arm touches nothing."""
    free: bool = True
    """True if the arm also moves free."""
    frequency_factor: tuple[float, float] = (0.95, 1.05)
    """Ratio of ω_n to the identified one."""
    delay_periods: tuple[float, float] = (0.0, 0.5)
    """Delay from the sample to the new voltage, in periods."""
    gain_factor: tuple[float, float] = (1.0, 1.0)
    """Ratio of the free response's slope to the one that the law assumes."""
    damping_factor: tuple[float, float] = (1.0, 1.0)
    """Ratio of ζ to the identified one."""
    assumed_mN_per_um: float | None = None
    """Contact stiffness, in mN/µm, that a law with ``previews`` assumes; None for the true one."""
    uninformed: bool = False
    """True if a contact may begin or end before the law is informed."""

    def __post_init__(self) -> None:
        if self.K_e_mN_per_um is None and not self.free:
            raise ValueError("no case: the arm is neither free nor in contact")
        for name in NAMES:
            interval: tuple[float, float] | None = getattr(self, name)
            if interval is not None and not interval[0] <= interval[1]:
                raise ValueError(f"{name}: from {interval[0]} to {interval[1]}, must be ascending")
        # Each ``LoopCase`` checks its own values.
        for values in product(
            self.K_e_mN_per_um or (0.0,),
            self.frequency_factor,
            self.delay_periods,
            self.gain_factor,
            self.damping_factor,
        ):
            LoopCase(*values)

    def middle(self) -> tuple[LoopCase, ...]:
        """Return the middle cases: free, and in contact."""
        factor, delay = _middle(self.frequency_factor), _middle(self.delay_periods)
        gain, damping = _middle(self.gain_factor), _middle(self.damping_factor)
        stiffness = [0.0] if self.free else []
        if self.K_e_mN_per_um is not None:
            stiffness.append(_middle(self.K_e_mN_per_um))
        return tuple(
            LoopCase(K_e, factor, delay, gain, damping, self.assumed_mN_per_um if K_e else None)
            for K_e in stiffness
        )

    def kinds(self) -> "Iterator[tuple[Intervals, float | None]]":
        """Yield the loops of the free and the pressed arm, with the stiffness given to the law."""
        free = replace(self, K_e_mN_per_um=None, free=True)
        pressed = None if self.K_e_mN_per_um is None else replace(self, free=False)
        if self.free:
            yield free, None
        if pressed is not None:
            yield pressed, self.assumed_mN_per_um
        if pressed is not None and self.uninformed:
            yield pressed, 0.0
            yield free, self.assumed_mN_per_um or _middle(self.K_e_mN_per_um or (0.0, 0.0))


def around(
    stiffness_mN_per_um: float,
    tolerance: float,
    delay_periods: tuple[float, float] = (0.0, 0.5),
    gain_factor: tuple[float, float] = (1.0, 1.0),
) -> Intervals:
    """Return intervals for a part whose stiffness has a relative tolerance below 1."""
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
    """Find the case with the largest spectral radius, and that radius.

    Negligible slow modes are ignored; see ``counted_radii``.

    Parameters
    ----------
    enough
        The search ends at the first case with at least this radius, although another case may be
        worse. This is sufficient for a refusal.
    """
    tops: list[tuple[LoopCase, float]] = []
    for kind, assumed in intervals.kinds():
        tops.append(_worst_of(loop, kind, assumed, limit_radius, enough))
        if tops[-1][1] >= enough:
            break
    return max(tops, key=lambda one: one[1])


@lru_cache(maxsize=256)
def worst_sensitivity(loop: Loop, intervals: Intervals) -> tuple[LoopCase, float]:
    """Find the largest M_s and its case, at the ends and in the middle of each interval.

    The law is assumed to be informed of the contact; without this information only the radius is
    assessed.
    """
    cases = corners(replace(intervals, uninformed=False))
    peaks = sensitivity_peaks(loop, cases)
    worst = int(np.argmax(peaks))
    return cases[worst], float(peaks[worst])


def corners(intervals: Intervals) -> tuple[LoopCase, ...]:
    """Return cases at the ends and in the middle of each interval, with the least damping."""
    cases: list[LoopCase] = []
    for kind, assumed in intervals.kinds():
        stiffness = kind.K_e_mN_per_um or (0.0, 0.0)
        axes = (
            _spaced(stiffness, 3),
            _spaced(kind.frequency_factor, 5),
            _spaced(kind.delay_periods, 3),
            _spaced(kind.gain_factor, 2),
            _spaced(kind.damping_factor, 2)[:1],
        )
        cases += [LoopCase(*values, assumed) for values in product(*axes)]
    return tuple(cases)


def _worst_of(
    loop: Loop, kind: Intervals, assumed: float | None, limit_radius: float, enough: float
) -> tuple[LoopCase, float]:
    axes = _axes(loop, kind)
    cases = tuple(LoopCase(*values, assumed) for values in product(*axes))
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
    """Return the grid's values of K_e, the factors and the delay, in the order of ``NAMES``."""
    stiffness = kind.K_e_mN_per_um or (0.0, 0.0)
    # Phase of the mode over a period, with the stiffest contact.
    phase = sqrt((loop.arm.k + stiffness[1]) / loop.arm.m) * loop.period_s
    return (
        _spaced(stiffness, WIDE_STIFFNESSES if kind.uninformed else STIFFNESSES),
        _spaced(kind.frequency_factor, _points(kind.frequency_factor, phase)),
        _spaced(kind.delay_periods, _points(kind.delay_periods, phase)),
        _spaced(kind.gain_factor, 2 if kind.uninformed else GAINS),
        _spaced(kind.damping_factor, 2),
    )


def _points(interval: tuple[float, float], phase: float) -> int:
    return min(POINTS, max(3, 1 + ceil((interval[1] - interval[0]) * phase / PHASE)))


def _spaced(interval: tuple[float, float], points: int) -> Axis:
    if interval[0] == interval[1]:
        return (interval[0],)
    return tuple(float(value) for value in np.linspace(interval[0], interval[1], points))


def _neighbours(axes: Axes, case: LoopCase, share: float) -> list[LoopCase]:
    """Return two cases along each quantity, at a fraction of the grid's spacing."""
    place = (
        case.K_e_mN_per_um,
        case.frequency_factor,
        case.delay_periods,
        case.gain_factor,
        case.damping_factor,
    )
    found: list[LoopCase] = []
    for index, axis in enumerate(axes):
        least, largest = min(axis), max(axis)
        if least == largest:
            continue
        spacing = (largest - least) / max(1, len(axis) - 1)
        for step in (-share * spacing, share * spacing):
            moved = list(place)
            moved[index] = min(largest, max(least, place[index] + step))
            K_e, factor, delay, gain, damping = moved
            assumed = case.assumed_mN_per_um
            found.append(LoopCase(K_e, factor, delay, gain, damping, assumed))
    return found


def _middle(interval: tuple[float, float]) -> float:
    return 0.5 * (interval[0] + interval[1])
