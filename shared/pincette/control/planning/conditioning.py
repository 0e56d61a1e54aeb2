"""Conditioning strokes, which bring the hysteresis of an arm to a known state before a grip.

A stroke to a low voltage erases the turning points of an unknown history, as far as they lie above
that voltage. Bouc-Wen hysteresis has no wiping-out property; its memory decays with the distance
travelled. With such hysteresis one stroke to -1 V leaves an error of up to 1.5 mN at 20 mN, and
three strokes leave 0.2 mN. Shallower strokes must be more numerous. Creep that began before the
strokes remains: 0.13 mN (95 %) after a rest of 2 s.

The strokes move away from the part. Their voltage stays within the range from which the free
response was identified, because the model is not known there and deeper strokes make a grip less
accurate.
"""

from pincette.control.planning.contact_request import MARGIN_UM
from pincette.control.planning.path_shapes import voltage_moves
from pincette.control.planning.profiles import move_duration
from pincette.control.planning.segments import Drive, Follow, Ramp, Stay
from pincette.control.response.conditioned_branch import STROKES

REST_S = 2.0
"""Rest after the strokes, in s, in which the creep that they cause decays."""
BOTTOM_S = 0.4
"""Rest at the lowest voltage of the last stroke, in s, before the voltage returns to 0 V."""
WATCH_S = 0.1
"""Time for which the resting arm is observed before the strokes, in s."""
RATE_SHARE = 0.9
"""Peak rate of a stroke, as a fraction of the slew limit."""
LEAST_DEPTH = 0.05
"""Smallest depth of the strokes below 0 V, as a fraction of the highest voltage of the
identification."""
WAY_SHARE = 0.3
"""Peak rate of the move to 0 V before the strokes, as a fraction of the slew limit. If the arm
already presses a part, the force rises by 1 mN per period at this rate."""
PHASE = "condition"


def stroke_depth_V(taught_V: tuple[float, float] | None, voltage_min_V: float) -> float | None:
    """Return the lowest voltage of the strokes, or None if the arm cannot be conditioned.

    Parameters
    ----------
    taught_V
        Lowest and highest voltage of the identification of the free response; None: not known.
    voltage_min_V
        Lower voltage limit of the rig. An arm with the limit 0 V, its rest voltage, cannot be
        conditioned.
    """
    if taught_V is None:
        return None
    low_V = max(taught_V[0], voltage_min_V)
    return low_V if -low_V >= LEAST_DEPTH * taught_V[1] else None


def conditioning(
    low_V: float, slew_V_per_s: float, away_um: float, d_p: float, strokes: int = STROKES
) -> list[Drive]:
    """Return the segments of a conditioning: a rest, a move to 0 V, the strokes, and a rest.

    The strokes begin and end at 0 V, where the arm may be nearer to the part than at present. If a
    part already presses the arm, the contact guard detects this by the force relative to the last
    zero: during the first rest, or during the move to 0 V if the force is small.

    Parameters
    ----------
    low_V
        Lowest voltage of the strokes, in V; see ``stroke_depth_V``.
    slew_V_per_s
        Slew limit of the rig.
    away_um
        Distance of the arm from its rest position at the start.
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
    """Return the stops of the strokes for ``voltage_moves``; the first and the last one are at 0 V.

    A grip and its calibration make the same strokes.
    """
    rate = RATE_SHARE * slew_V_per_s
    stops = [(0.0, rate, 0.0)]
    for number in range(1, strokes + 1):
        rest_s = BOTTOM_S if number == strokes else 0.0
        stops.extend([(low_V, rate, rest_s), (0.0, rate, 0.0)])
    return stops
