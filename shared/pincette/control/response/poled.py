"""The memory of a poled arm: one that has been at both ends of its range, then rested at 0 V.

A program that starts knows nothing of the arm's past. An arm that has been identified was led over
its whole range then, and has been above its rest ever since: its remanence is that of a poled
actuator. Only an arm that is new, or that was depolarised, begins as ``hysteresis.start`` has it.
"""

from math import ceil

from pincette.control.response.hysteresis import HysteresisModel, HysteresisState, start, step

STRIDE_V = 0.05
"""Longest step in which the model is led; fading depends on the way alone."""
STRIDE_S = 0.01
REST_S = 86_400.0
"""After which creep is over."""


def poled(model: HysteresisModel, taught_V: tuple[float, float]) -> HysteresisState:
    """Return the memory at 0 V of an arm that went to the largest voltage, then to the least.

    Parameters
    ----------
    taught_V
        Least and largest voltage that the model was identified from.
    """
    low_V, high_V = taught_V
    state = start(model)
    for to_V in (high_V, low_V, 0.0):
        from_V = state.voltage_V
        strides = max(1, ceil(abs(to_V - from_V) / STRIDE_V))
        for stride in range(1, strides + 1):
            state = step(model, state, from_V + stride / strides * (to_V - from_V), STRIDE_S)
    return step(model, state, 0.0, REST_S)
