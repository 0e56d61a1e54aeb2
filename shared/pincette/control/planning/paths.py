"""Paths of one reference over time, from rest to rest, in the unit of the reference.

A sinusoid and a triangle swing about a mean, and blend in and out over whole cycles:

    value(t) = mean + amplitude·w(t)·c(t/cycle)

with c odd, of period and amplitude 1, and w the quintic from 0 to 1 and back. Steps and waypoints
are quintic pieces between knots. A path depends only on the time since its start, so that it is
bitwise equal wherever it is computed.
"""

from math import cos, isfinite, pi, sin
from typing import Literal, NamedTuple

from pincette.control.checks import require_positive
from pincette.control.planning.profiles import move
from pincette.control.quantities import Items, Number, Second, Whole
from pincette.control.record import FrozenRecord

Shape = Literal["sinusoid", "triangle", "step", "waypoints"]
Quantity = Literal["force", "position", "voltage"]


class Knot(FrozenRecord, frozen=True):
    """Value of a path at a time, and its rate."""

    t_s: Second
    value: Number
    rate: Number


class Point(NamedTuple):
    """Value of a path, and its first and second time derivatives."""

    value: float
    rate: float
    acceleration: float


class Path(FrozenRecord, frozen=True):
    """A path of force in mN, of position in µm, or of voltage in V.

    Paths of force are made by ``path_shapes``.

    Raises
    ------
    ValueError
        If the numbers do not describe a path.
    """

    quantity: Quantity
    shape: Shape
    mean: Number = 0.0
    amplitude: Number = 0.0
    cycle_s: Second = 0.0
    cycles: Whole = 0
    """Number of cycles at full amplitude."""
    blend_cycles: Whole = 1
    """Number of cycles in which the amplitude grows, and in which it decays."""
    corner: Number = 0.0
    """Half the duration of a triangle's corner, as a fraction of the cycle; at most 1/4."""
    knots: Items[Knot] = ()
    relative: bool = False
    """True for a voltage that is relative to the one at the start of the path."""

    def __post_init__(self) -> None:
        if self.knots or self.shape in ("step", "waypoints"):
            _check_knots(self.knots)
            return
        require_positive("cycle", self.cycle_s, "s")
        if not (isfinite(self.mean) and isfinite(self.amplitude)):
            raise ValueError(f"mean {self.mean} and amplitude {self.amplitude} must be finite")
        if self.cycles < 1 or self.blend_cycles < 1:
            raise ValueError(
                f"{self.cycles} cycles and {self.blend_cycles} to blend, must be at least 1"
            )
        if self.shape == "triangle" and not 0.0 < self.corner <= 0.25:
            raise ValueError(f"corner = {self.corner}, must be above 0 and at most 0.25")

    @property
    def duration_s(self) -> float:
        """Return the duration from rest to rest."""
        if self.knots:
            return self.knots[-1].t_s
        return (self.cycles + 2 * self.blend_cycles) * self.cycle_s

    @property
    def full_from_s(self) -> float:
        """Return the time at which the cycles at full amplitude begin, in s; 0 for knots."""
        return 0.0 if self.knots else self.blend_cycles * self.cycle_s

    @property
    def full_to_s(self) -> float:
        """Return the time at which the cycles at full amplitude end, in s."""
        return self.duration_s - self.full_from_s

    @property
    def start(self) -> float:
        """Return the value before and at the start."""
        return self.knots[0].value if self.knots else self.mean

    def share(self, t_s: float) -> float:
        """Return the factor w of the amplitude at a time since the start; 1 for knots."""
        if self.knots:
            return 1.0
        left_s = min(t_s, self.duration_s - t_s)
        return _blend(max(0.0, left_s) / (self.blend_cycles * self.cycle_s)).value

    def at(self, t_s: float) -> float:
        """Return the value at a time since the start, clamped to the ends."""
        return self.point(t_s).value

    def point(self, t_s: float) -> Point:
        """Return value, rate and acceleration at a time since the start; outside it is at rest."""
        if self.knots:
            return _between(self.knots, t_s)
        return self._swing(min(max(t_s, 0.0), self.duration_s))

    def _swing(self, t_s: float) -> Point:
        share = t_s / self.cycle_s
        share -= int(share)
        c, c_1, c_2 = _sine(share) if self.shape == "sinusoid" else _triangle(share, self.corner)
        blend_s = self.blend_cycles * self.cycle_s
        left_s = self.duration_s - t_s
        w, w_1, w_2 = _blend(min(t_s, left_s) / blend_s)
        # Convert rates per cycle and per blend to rates per second.
        c_1, c_2 = c_1 / self.cycle_s, c_2 / (self.cycle_s * self.cycle_s)
        w_1 = (w_1 if t_s < left_s else -w_1) / blend_s
        w_2 = w_2 / (blend_s * blend_s)
        return Point(
            self.mean + self.amplitude * (w * c),
            self.amplitude * (w_1 * c + w * c_1),
            self.amplitude * (w_2 * c + 2.0 * w_1 * c_1 + w * c_2),
        )


def _check_knots(knots: tuple[Knot, ...]) -> None:
    if len(knots) < 2 or knots[0].t_s != 0.0:
        raise ValueError("a path needs at least two knots, the first at 0 s")
    if knots[0].rate != 0.0 or knots[-1].rate != 0.0:
        raise ValueError("a path begins and ends at rest")
    before_s = -1.0
    for knot in knots:
        if not (isfinite(knot.t_s) and isfinite(knot.value) and isfinite(knot.rate)):
            raise ValueError(f"knot at {knot.t_s} s: {knot.value}, rate {knot.rate}, not finite")
        if knot.t_s <= before_s:
            raise ValueError(f"knot at {knot.t_s} s, must be after {before_s} s")
        before_s = knot.t_s


def _between(knots: tuple[Knot, ...], t_s: float) -> Point:
    """Return value, rate and acceleration on the quintic piece at a time."""
    if t_s <= 0.0:
        return Point(knots[0].value, 0.0, 0.0)
    if t_s >= knots[-1].t_s:
        return Point(knots[-1].value, 0.0, 0.0)
    low, high = 0, len(knots) - 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if knots[middle].t_s <= t_s else (low, middle)
    before, after = knots[low], knots[high]
    piece = move(before.value, before.rate, after.value, after.rate, after.t_s - before.t_s)
    t_s -= before.t_s
    return Point(piece.position(t_s), piece.speed(t_s), piece.acceleration(t_s))


def _blend(s: float) -> Point:
    """Return a quintic from 0 to 1 over s, with its derivatives by s; see ``profiles.quintic``."""
    if s >= 1.0:
        return Point(1.0, 0.0, 0.0)
    left = 1.0 - s
    return Point(
        s * s * s * (10.0 + s * (6.0 * s - 15.0)),
        30.0 * s * s * left * left,
        60.0 * s * left * (left - s),
    )


def _sine(share: float) -> Point:
    angle = 2.0 * pi * share
    value, slope = sin(angle), cos(angle)
    return Point(value, 2.0 * pi * slope, -4.0 * pi * pi * value)


def _triangle(share: float, corner: float) -> Point:
    """Return a triangle with parabolic corners that reach 1, as a function of the cycle's phase."""
    slope = 1.0 / (0.25 - 0.5 * corner)
    side, half = (1.0, share) if share < 0.5 else (-1.0, share - 0.5)
    past = half - 0.25
    if abs(past) >= corner:
        return Point(
            side * slope * (0.25 - abs(past)), -side * slope if past > 0.0 else side * slope, 0.0
        )
    bend = slope / corner
    return Point(side * (1.0 - 0.5 * bend * past * past), -side * bend * past, -side * bend)
