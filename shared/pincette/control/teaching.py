"""The free motion from which the free response of an arm is identified."""

from pincette.control.checks import require_positive
from pincette.control.profiles import minimum_duration
from pincette.control.program import Guards, Program, Segment

COURSE = (
    # Each a share of the range, and a rest in s: a grip, then reversals within reversals.
    *((0.52, 0.4), (0.66, 0.2), (0.95, 3.0), (0.55, 0.0), (0.0, 0.3)),
    *((0.56, 0.4), (1.0, 1.0), (0.45, 0.0), (0.8, 0.5), (0.2, 0.0), (0.6, 0.4), (0.9, 1.5)),
    *((0.62, 0.0), (0.05, 0.3)),
    *((0.5, 0.4), (0.62, 0.2), (0.85, 3.0), (0.6, 0.0), (0.7, 0.3), (0.1, 0.2)),
    *((0.55, 0.4), (0.93, 2.0), (0.0, 0.4)),
)
"""The last two lines, about a third of the time, are grips again."""
SHORTEST_MOVE_S = 0.3


def teaching_program(from_um: float, to_um: float, speed_um_per_s: float) -> Program:
    """Free motion over a range of positions, at the peak speed given.

    Raises
    ------
    ValueError
        Where the range or the speed is not finite and positive.
    """
    range_um = require_positive("range of the teaching motion", to_um - from_um, "µm")
    require_positive("speed of the teaching motion", speed_um_per_s, "µm/s")
    segments: list[Segment] = []
    at_um = 0.0
    for share, rest_s in COURSE:
        x_um = from_um + share * range_um
        move_s = max(SHORTEST_MOVE_S, minimum_duration(x_um - at_um, speed_um_per_s))
        segments.append(Segment("teach", "free", move_s, x_to_um=x_um))
        if rest_s > 0.0:
            segments.append(Segment("teach", "free", rest_s, x_to_um=x_um))
        at_um = x_um
    return Program(tuple(segments), _UNGUARDED, contact_stiffness_mN_per_um=1.0)


_UNGUARDED = Guards(
    contact_force_mN=1.0,
    contact_samples=1,
    force_max_mN=1.0,
    lost_fraction=0.0,
    lost_samples=1,
    stiffness_min_mN_per_um=0.0,
    stiffness_max_mN_per_um=1.0,
    zero_wait_s=1.0,
)
"""Nothing is touched, and without a zero no guard of force acts."""
