"""The free motion from which the free response of an arm is identified."""

from typing import NamedTuple

from pincette.control.checks import require_positive
from pincette.control.planning.calibration_programs import free_program
from pincette.control.planning.profiles import move_duration
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Move


class Leg(NamedTuple):
    """A move to a fraction of the range, at a fraction of the speed, followed by a rest in s."""

    to: float
    rest_s: float = 0.0
    pace: float = 1.0


SLOW = 1.0 / 3.0
COURSE = (
    # Growing swings from the unpoled state of a new rig, whose first stroke has its own branch.
    *(Leg(0.0, 2.0), Leg(0.2), Leg(0.0, 0.4), Leg(0.4), Leg(0.0, 0.4), Leg(0.7), Leg(0.0, 0.4)),
    # The whole range, which erases the earlier memory; then swings of different widths.
    *(Leg(1.0, 0.4), Leg(0.0, 0.3), Leg(1.0), Leg(0.0, 0.3)),
    *(Leg(0.8), Leg(0.1), Leg(0.8), Leg(0.1), Leg(0.65), Leg(0.3), Leg(0.7), Leg(0.2)),
    # A grip, loops at its highest position as in normal operation, and a drift with small loops.
    *(Leg(0.56, 0.4, SLOW), Leg(0.66, 0.2, SLOW), Leg(0.95, 3.0, SLOW)),
    *(Leg(0.75), Leg(0.95), Leg(0.75), Leg(0.95), Leg(0.8), Leg(0.9), Leg(0.78), Leg(0.88)),
    *(Leg(0.55, 0.0, SLOW), Leg(0.05, 0.3)),
    # Reversals within reversals, at rests of several lengths.
    *(Leg(0.6), Leg(0.3), Leg(0.5), Leg(0.35), Leg(1.0, 2.0), Leg(0.45), Leg(0.8, 0.5)),
    *(Leg(0.2), Leg(0.6, 0.4), Leg(0.9, 1.5), Leg(0.62), Leg(0.0, 1.0)),
    # Another grip, and swings again, on which the model is chosen and tested.
    *(Leg(0.5, 0.4, SLOW), Leg(0.62, 0.2, SLOW), Leg(0.88, 2.0, SLOW)),
    *(Leg(0.7), Leg(0.88), Leg(0.7), Leg(0.88), Leg(0.65), Leg(0.1, 0.2)),
    *(Leg(0.8), Leg(0.1), Leg(0.8), Leg(0.25), Leg(0.6), Leg(0.4), Leg(0.55, 0.4)),
    *(Leg(0.93, 2.0, SLOW), Leg(0.73), Leg(0.93), Leg(0.0, 0.4)),
)


def teaching_program(from_um: float, to_um: float, speed_um_per_s: float) -> Program:
    """Return a program that moves the free arm over a range of positions, at a given peak speed.

    Raises
    ------
    ValueError
        If the range or the speed is not finite and positive.
    """
    range_um = require_positive("range of the teaching motion", to_um - from_um, "µm")
    require_positive("speed of the teaching motion", speed_um_per_s, "µm/s")
    segments: list[Move] = []
    at_um = 0.0
    for leg in COURSE:
        x_um = from_um + leg.to * range_um
        move_s = move_duration(x_um - at_um, leg.pace * speed_um_per_s)
        segments.append(Move("teach", move_s, to_um=(x_um,)))
        if leg.rest_s > 0.0:
            segments.append(Move("teach", leg.rest_s, to_um=(x_um,)))
        at_um = x_um
    return free_program(*segments)
