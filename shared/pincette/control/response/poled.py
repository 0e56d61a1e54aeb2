"""Memory of a poled arm, which has been at both ends of its range and then rested at 0 V.

A program that starts does not know the arm's history. But during identification the arm was moved
over its whole range, and since then its voltage has not been below that of the rest: its remanence
is that of a poled actuator. Only a new arm, or one that was depolarised, begins with the memory of
``hysteresis.start``.
"""

from collections.abc import Sequence
from math import ceil

from msgspec.structs import replace

from pincette.control.response.conditioned_branch import ConditionedBranch
from pincette.control.response.hysteresis import HysteresisModel, HysteresisState, start, step

STRIDE_V = 0.05
"""Longest step in which the model follows the voltage, in V. Fading depends on the voltage travel
only."""
STRIDE_S = 0.01
REST_S = 86_400.0
"""Duration of a rest after which creep is over, in s."""


def poled(
    model: HysteresisModel, taught_V: tuple[float, float], *, from_above: bool = False
) -> HysteresisState:
    """Return the memory at 0 V of an arm that went to the largest voltage, then to the lowest.

    Parameters
    ----------
    taught_V
        Lowest and highest voltage of the motion that the model was identified from.
    from_above
        True if the voltage came down to 0 V before the rest, as after a grip. Remanence raises the
        displacement at such a rest. Conditioning strokes later erase this memory of the plays, but
        not the creep that follows the displacement. It is not known how far the creep has followed,
        so the creep states are the means of a rest from above and one from below.
    """
    low_V, high_V = taught_V
    state = _moved(model, start(model), (high_V, low_V, 0.0))
    rested = step(model, state, 0.0, REST_S)
    if not from_above:
        return rested
    above = _moved(model, state, (high_V, 0.0))
    ended_um = 0.5 * (above.static_um + rested.static_um)
    return replace(rested, creep_um=(ended_um,) * len(rested.creep_um))


def stroked(model: HysteresisModel, branch: ConditionedBranch) -> HysteresisState:
    """Return the memory of a poled arm at the lowest voltage of its last conditioning stroke."""
    low_V, high_V = branch.voltages_V[0], branch.voltages_V[-1]
    stops_V = (*(low_V, 0.0) * (branch.strokes - 1), low_V)
    return _moved(model, poled(model, (low_V, high_V)), stops_V)


def _moved(
    model: HysteresisModel, state: HysteresisState, stops_V: Sequence[float]
) -> HysteresisState:
    for to_V in stops_V:
        from_V = state.voltage_V
        strides = max(1, ceil(abs(to_V - from_V) / STRIDE_V))
        for stride in range(1, strides + 1):
            state = step(model, state, from_V + stride / strides * (to_V - from_V), STRIDE_S)
    return state
