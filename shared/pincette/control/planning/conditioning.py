"""Conditioning strokes: they bring the hysteresis of an arm to a known state before it grips.

A voltage stroke to a low end wipes out the turning points of an unknown past, as far as they lie
above that end. Arms of the Bouc-Wen class have no wiping-out and forget with the length of the way
instead, so one stroke leaves up to 1.5 mN of 20 mN there and three leave 0.2 mN. What is left after
three strokes is creep of the old past, 0.13 mN (95 %) after a rest of 2 s.

The strokes lead away from the part and no lower than the voltages that the free response was
identified from: below them the model is not known, and strokes there make a grip worse.
"""

from pincette.control.planning.contact_request import MARGIN_UM
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.profiles import move_duration
from pincette.control.planning.program import Segment

STROKES = 3
REST_S = 2.0
"""After the strokes, in which the creep that they cause decays."""
RATE_SHARE = 0.9
"""Peak rate of a stroke, as a share of the slew limit."""
LEAST_DEPTH = 0.05
"""Depth below 0 V that strokes need, as a share of the highest voltage identified."""
PHASE = "condition"


def stroke_depth_V(taught_V: tuple[float, float] | None, voltage_min_V: float) -> float | None:
    """Return the lowest voltage of the strokes; None where the arm cannot be conditioned.

    Parameters
    ----------
    taught_V
        Least and largest voltage that the free response was identified from; None: not known.
    voltage_min_V
        Limit of the rig. An arm whose limit is at its rest, 0 V, cannot be conditioned.
    """
    if taught_V is None:
        return None
    low_V = max(taught_V[0], voltage_min_V)
    return low_V if -low_V >= LEAST_DEPTH * taught_V[1] else None


def conditioning(low_V: float, slew_V_per_s: float, away_um: float, d_p: float) -> list[Segment]:
    """Return the segments of a conditioning: a move to 0 V, the strokes, and a rest.

    Parameters
    ----------
    low_V
        Lowest voltage, as ``stroke_depth_V`` gives it.
    slew_V_per_s
        Slew limit of the rig.
    away_um
        Distance of the arm from its rest position as they begin.
    d_p
        Gain in µm/V.
    """
    rate = RATE_SHARE * slew_V_per_s
    away_V = (abs(away_um) + MARGIN_UM) / d_p
    strokes = [stop for _ in range(STROKES) for stop in ((low_V, rate, 0.0), (0.0, rate, 0.0))]
    path = voltage_moves([(0.0, rate, 0.0), *strokes])
    return [
        Segment(PHASE, "voltage", move_duration(away_V, rate), voltage_to_V=0.0),
        Segment(PHASE, "voltage", path.duration_s + REST_S, path=path),
    ]
