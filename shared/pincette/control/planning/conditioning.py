"""Conditioning strokes, which bring the hysteresis of an arm to a known state before a grip.

A voltage stroke to a low end wipes out the turning points of an unknown past, as far as they lie
above that end. Arms of the Bouc-Wen class have no wiping-out and forget with the length of the way
instead, so one stroke to -1 V leaves up to 1.5 mN of 20 mN there and three leave 0.2 mN; shallower
strokes must be more numerous. Creep of the old past remains: 0.13 mN (95 %) after a rest of 2 s.

The strokes move away from the part, and no lower than the voltages that the free response was
identified from. Below them the model is not known, and strokes there make a grip worse.
"""

from pincette.control.planning.contact_request import MARGIN_UM
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.profiles import move_duration
from pincette.control.planning.segments import Drive, Follow, Ramp, Stay
from pincette.control.response.conditioned_branch import STROKES

REST_S = 2.0
"""Rest after the strokes, in s, in which the creep that they cause decays."""
BOTTOM_S = 0.4
"""Rest at the bottom of the last stroke, in s, before the way to the place of the zero."""
WATCH_S = 0.1
"""Time for which the resting arm is observed before the strokes, in s."""
RATE_SHARE = 0.9
"""Peak rate of a stroke as a share of the slew limit."""
LEAST_DEPTH = 0.05
"""Depth below 0 V that strokes need, as a share of the highest voltage identified."""
WAY_SHARE = 0.3
"""Peak rate of the move to 0 V before the strokes, as a share of the slew limit. It leads towards a
part that may press the arm already, whose force then rises by 1 mN a period."""
PHASE = "condition"


def stroke_depth_V(taught_V: tuple[float, float] | None, voltage_min_V: float) -> float | None:
    """Return the lowest voltage of the strokes, or None where the arm cannot be conditioned.

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


def conditioning(
    low_V: float, slew_V_per_s: float, away_um: float, d_p: float, strokes: int = STROKES
) -> list[Drive]:
    """Return the segments of a conditioning: a watch, a move to 0 V, the strokes, and a rest.

    The strokes end at 0 V, which may be nearer to the part than the arm's present place. A part
    that already presses the arm there is found by the last zero: before the voltage changes, or on
    the way to 0 V if it presses too lightly for that.

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
    strokes
        Number of strokes.
    """
    away_V = (abs(away_um) + MARGIN_UM) / d_p
    path = voltage_moves(stroke_stops(low_V, slew_V_per_s, strokes))
    return [
        Drive(PHASE, WATCH_S, guarded=True, courses=(Stay(),)),
        Drive(
            PHASE,
            move_duration(away_V, WAY_SHARE * slew_V_per_s),
            guarded=True,
            courses=(Ramp(0.0),),
        ),
        Drive(PHASE, path.duration_s + REST_S, courses=(Follow(path),)),
    ]


def stroke_stops(
    low_V: float, slew_V_per_s: float, strokes: int
) -> list[tuple[float, float, float]]:
    """Return the stops of the strokes for ``voltage_moves``; the first and the last are at 0 V.

    A grip and its calibration make the same strokes.
    """
    rate = RATE_SHARE * slew_V_per_s
    stops = [(0.0, rate, 0.0)]
    for number in range(1, strokes + 1):
        rest_s = BOTTOM_S if number == strokes else 0.0
        stops.extend([(low_V, rate, rest_s), (0.0, rate, 0.0)])
    return stops
