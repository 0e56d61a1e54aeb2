"""Construction of paths of each shape, and the extremes of a path and of its derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.planning.paths import Knot, Path, Quantity
from pincette.control.planning.profiles import minimum_duration, move_duration
from pincette.control.quantities import MAX_ITEMS

KNOTS_MAX = MAX_ITEMS
"""Largest number of knots that fit into one message."""
CLOSEST_S = 1e-6
"""Shortest time between two points of a path, in s."""
CORNER_SHARE = 0.75
"""Fraction of the permitted acceleration that a triangle uses at its corners."""
PIECE_POINTS, CYCLE_POINTS = 64, 512
"""Number of points at which a piece and a cycle are sampled to find their peaks."""
PATH_POINTS = 16_384
"""Number of points at which a path of many pieces is sampled, divided among its pieces."""


@dataclass(frozen=True, slots=True)
class Peaks:
    """Extremes of a path and its derivatives, and the times at which they are first reached.

    They are determined by sampling, and are too low by at most 1e-3 of the value.
    """

    lowest: float
    highest: float
    rate: float
    rate_at_s: float
    acceleration: float
    acceleration_at_s: float


def sinusoid(
    quantity: Quantity, mean: float, peak_to_peak: float, frequency_hz: float, cycles: int
) -> Path:
    """Return a sine about a mean, from the mean upwards.

    Raises ValueError unless all arguments are positive.
    """
    return Path(
        quantity,
        "sinusoid",
        mean=mean,
        amplitude=0.5 * require_positive("peak to peak", peak_to_peak, ""),
        cycle_s=1.0 / require_positive("frequency", frequency_hz, "Hz"),
        cycles=cycles,
    )


def triangle(
    quantity: Quantity,
    mean: float,
    peak_to_peak: float,
    frequency_hz: float,
    cycles: int,
    acceleration: float,
) -> Path:
    """Return a triangle about a mean, from the mean upwards, with rounded corners.

    The rounded corners reach the peak values. A corner uses ``CORNER_SHARE`` of the given
    acceleration, so that the acceleration stays within its limit when that of the blend is added.
    If even a triangle that consists of two parabolic corners needs more, this triangle is returned.

    Raises
    ------
    ValueError
        If a number is not positive.
    """
    amplitude = 0.5 * require_positive("peak to peak", peak_to_peak, "")
    cycle_s = 1.0 / require_positive("frequency", frequency_hz, "Hz")
    limit = CORNER_SHARE * require_positive("acceleration of a corner", acceleration, "1/s²")
    # Acceleration amplitude/(cycle²·h·(1/4 - h/2)) for half a corner h, solved for the smaller h.
    product = amplitude / (cycle_s * cycle_s * limit)
    corner = 0.25 - sqrt(max(0.0, 0.0625 - 2.0 * product))
    return Path(
        quantity,
        "triangle",
        mean=mean,
        amplitude=amplitude,
        cycle_s=cycle_s,
        cycles=cycles,
        corner=corner,
    )


def steps(
    quantity: Quantity, levels: Sequence[float], dwell_s: float, rate: float, acceleration: float
) -> Path:
    """Return a path that rests at each level and moves between levels as fast as the limits allow.

    Raises
    ------
    ValueError
        If there is no level, dwell, rate or acceleration is not positive, or there are more
        levels than ``KNOTS_MAX``/2.
    """
    require_positive("dwell", dwell_s, "s")
    if not 1 <= len(levels) <= KNOTS_MAX // 2:
        raise ValueError(f"{len(levels)} levels, must be 1 to {KNOTS_MAX // 2}")
    knots = [Knot(0.0, levels[0], 0.0)]
    for level in levels:
        t_s, distance = knots[-1].t_s, level - knots[-1].value
        if distance != 0.0:
            t_s += minimum_duration(distance, rate, acceleration)
            knots.append(Knot(t_s, level, 0.0))
        knots.append(Knot(t_s + dwell_s, level, 0.0))
    return Path(quantity, "step", knots=tuple(knots))


def waypoints(quantity: Quantity, points: Sequence[tuple[float, float]]) -> Path:
    """Return a path through values at times, smooth and without overshoot; at rest at both ends.

    The rate at a point is the harmonic mean of the mean rates before and after it, or 0 if they
    differ in sign. It is at most twice as large as either of them, so that each quintic piece stays
    between its ends.

    Parameters
    ----------
    points
        Pairs of a time in s, ascending from 0, and a value.

    Raises
    ------
    ValueError
        If there are fewer than two points or more than ``KNOTS_MAX``, times do not ascend
        from 0, or two of them are less than ``CLOSEST_S`` apart.
    """
    if not 2 <= len(points) <= KNOTS_MAX:
        raise ValueError(f"{len(points)} points, must be 2 to {KNOTS_MAX}")
    for index in range(1, len(points)):
        gap_s = points[index][0] - points[index - 1][0]
        require_positive(f"time from point {index - 1} to point {index}", gap_s, "s")
        if gap_s < CLOSEST_S:
            raise ValueError(
                f"time from point {index - 1} to point {index} = {gap_s:g} s, must be "
                f"{CLOSEST_S:g} s or more: omit one of them"
            )
    knots: list[Knot] = []
    for index, (t_s, value) in enumerate(points):
        rate = 0.0
        if 0 < index < len(points) - 1:
            rate = _passing_rate(points[index - 1], points[index], points[index + 1])
        knots.append(Knot(t_s, value, rate))
    return Path(quantity, "waypoints", knots=tuple(knots))


def _passing_rate(
    before: tuple[float, float], here: tuple[float, float], after: tuple[float, float]
) -> float:
    rate_in = (here[1] - before[1]) / (here[0] - before[0])
    rate_out = (after[1] - here[1]) / (after[0] - here[0])
    if rate_in * rate_out <= 0.0:
        return 0.0
    return 2.0 * rate_in * rate_out / (rate_in + rate_out)


def peaks(path: Path) -> Peaks:
    """Return the extremes of a path, over each piece, or over the blend and one full cycle."""
    if path.knots:
        ends = [knot.t_s for knot in path.knots]
        points = min(PIECE_POINTS, PATH_POINTS // (len(ends) - 1))
    else:
        points = CYCLE_POINTS
        ends = [cycle * path.cycle_s for cycle in range(path.blend_cycles + 2)]
    first = path.point(0.0)
    lowest = highest = first.value
    rate = rate_at_s = acceleration = acceleration_at_s = 0.0
    for index in range(1, len(ends)):
        begin_s, length_s = ends[index - 1], ends[index] - ends[index - 1]
        for point in range(points + 1):
            t_s = begin_s + length_s * point / points
            value, speed, bend = path.point(t_s)
            lowest, highest = min(lowest, value), max(highest, value)
            if abs(speed) > rate:
                rate, rate_at_s = abs(speed), t_s
            if abs(bend) > acceleration:
                acceleration, acceleration_at_s = abs(bend), t_s
    return Peaks(lowest, highest, rate, rate_at_s, acceleration, acceleration_at_s)


def ring_um(acceleration_um_per_s2: float, natural_frequency_rad_per_s: float) -> float:
    """Return the amplitude a/ω_n² in µm of the ringing after a sudden acceleration a.

    It is the quasi-static deflection of the mode under that acceleration. No law with T ≫ 2π/ω_n
    can suppress it. The effect of the stepwise voltage is not included.
    """
    a = require_not_negative("acceleration", acceleration_um_per_s2, "µm/s²")
    omega_n = require_positive("natural frequency", natural_frequency_rad_per_s, "rad/s")
    return a / (omega_n * omega_n)


def voltage_moves(stops: Sequence[tuple[float, float, float]], *, relative: bool = False) -> Path:
    """Return a voltage path that moves smoothly from stop to stop.

    Parameters
    ----------
    stops
        Voltage of each stop in V, peak rate of the move to it in V/s, and rest after it in s. The
        path begins at the first stop, whose rate is not used.
    relative
        True if the voltages are relative to the voltage at the start of the path.
    """
    first_V, _, rest_s = stops[0]
    knots = [Knot(0.0, first_V, 0.0)]

    def rest(for_s: float) -> None:
        if for_s > 0.0:
            knots.append(Knot(knots[-1].t_s + for_s, knots[-1].value, 0.0))

    rest(rest_s)
    for voltage_V, rate_V_per_s, rest_s in stops[1:]:
        way_V = voltage_V - knots[-1].value
        move_s = move_duration(way_V, rate_V_per_s)
        knots.append(Knot(knots[-1].t_s + move_s, voltage_V, 0.0))
        rest(rest_s)
    return Path("voltage", "step", knots=tuple(knots), relative=relative)
