"""Smooth moves of a reference, in position or in force; the caller chooses the unit."""

from math import sqrt

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.record import FrozenRecord

PEAK_SPEED = 15.0 / 8.0
"""Peak of |q'(s)| of the quintic from rest to rest, at s = 1/2."""
PEAK_ACCELERATION = 10.0 / sqrt(3.0)
"""Peak of |q''(s)| of the quintic from rest to rest."""
SHORTEST_MOVE_S = 0.3
"""Shortest duration of a move, and the drawn duration of a segment without an end, in s."""


def quintic(s: float) -> float:
    """Return the completed fraction of a move at the fraction ``s`` of its time: 10s³ - 15s⁴ + 6s⁵.

    It is 0 before and 1 after; speed and acceleration vanish at both ends.
    """
    if s <= 0.0:
        return 0.0
    if s >= 1.0:
        return 1.0
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


class Quintic(FrozenRecord, frozen=True):
    """Polynomial x(t) = x_0 + v_0 t + c_3 s³ + c_4 s⁴ + c_5 s⁵, s = t/duration.

    The acceleration is 0 at both ends. Before the start and after the end x rests.
    """

    start: float
    start_speed: float
    end: float
    end_speed: float
    duration_s: float
    c_3: float
    c_4: float
    c_5: float

    def position(self, t_s: float) -> float:
        """Return the position at ``t_s`` since the start of the move, clamped to its ends."""
        if t_s <= 0.0:
            return self.start
        if t_s >= self.duration_s:
            return self.end
        s = t_s / self.duration_s
        return (
            self.start
            + self.start_speed * t_s
            + s * s * s * (self.c_3 + s * (self.c_4 + s * self.c_5))
        )

    def speed(self, t_s: float) -> float:
        """Return the speed at ``t_s``; outside the move the speed at its nearer end."""
        if t_s <= 0.0:
            return self.start_speed
        if t_s >= self.duration_s:
            return self.end_speed
        s = t_s / self.duration_s
        shape = s * s * (3.0 * self.c_3 + s * (4.0 * self.c_4 + s * 5.0 * self.c_5))
        return self.start_speed + shape / self.duration_s

    def acceleration(self, t_s: float) -> float:
        """Return the acceleration at ``t_s``; 0 outside the move."""
        if t_s <= 0.0 or t_s >= self.duration_s:
            return 0.0
        s = t_s / self.duration_s
        shape = s * (6.0 * self.c_3 + s * (12.0 * self.c_4 + s * 20.0 * self.c_5))
        return shape / (self.duration_s * self.duration_s)


def move(
    start: float, start_speed: float, end: float, end_speed: float, duration_s: float
) -> Quintic:
    """Plan a move between two positions with given speeds, and acceleration 0, at both ends.

    Raises
    ------
    ValueError
        If the duration is not finite and positive.
    """
    T = require_positive("duration of a move", duration_s, "s")
    distance = end - start
    return Quintic(
        start=start,
        start_speed=start_speed,
        end=end,
        end_speed=end_speed,
        duration_s=T,
        c_3=10.0 * distance - (6.0 * start_speed + 4.0 * end_speed) * T,
        c_4=-15.0 * distance + (8.0 * start_speed + 7.0 * end_speed) * T,
        c_5=6.0 * distance - 3.0 * (start_speed + end_speed) * T,
    )


def run_up(distance: float, duration_s: float, up_s: float, t_s: float) -> tuple[float, float]:
    """Return distance and speed at ``t_s`` of a smooth acceleration to a constant speed.

    With v = distance/(duration - up/2) and s = t/up the speed is v·(3s² - 2s³) until s = 1, so that
    the acceleration is 0 at both ends, and then v. If ``up_s`` is 0, the speed is v from the start.

    Raises
    ------
    ZeroDivisionError
        If the duration is half of ``up_s``.
    """
    speed = distance / (duration_s - 0.5 * up_s)
    if t_s >= up_s:
        return speed * (t_s - 0.5 * up_s), speed
    s = t_s / up_s
    return speed * up_s * s * s * s * (1.0 - 0.5 * s), speed * s * s * (3.0 - 2.0 * s)


def run_up_acceleration(distance: float, duration_s: float, up_s: float, t_s: float) -> float:
    """Return the acceleration at ``t_s`` of ``run_up``: v·6s·(1 - s)/up until s = 1, then 0."""
    if not 0.0 < t_s < up_s:
        return 0.0
    speed, s = distance / (duration_s - 0.5 * up_s), t_s / up_s
    return speed * 6.0 * s * (1.0 - s) / up_s


def minimum_duration(distance: float, speed: float, acceleration: float | None = None) -> float:
    """Return the shortest time in s of a move from rest to rest within speed and acceleration.

    It is the larger one of (15/8)·|distance|/speed and √((10/√3)·|distance|/acceleration).

    Raises
    ------
    ValueError
        If speed or acceleration is not finite and positive.
    """
    length = require_not_negative("distance of a move", abs(distance), "")
    duration_s = PEAK_SPEED * length / require_positive("peak speed", speed, "1/s")
    if acceleration is None:
        return duration_s
    limit = require_positive("peak acceleration", acceleration, "1/s²")
    return max(duration_s, sqrt(PEAK_ACCELERATION * length / limit))


def move_duration(distance: float, speed: float) -> float:
    """Return the duration of a move in s: ``minimum_duration``, at least ``SHORTEST_MOVE_S``.

    Raises
    ------
    ValueError
        If the speed is not finite and positive.
    """
    return max(SHORTEST_MOVE_S, minimum_duration(distance, speed))
