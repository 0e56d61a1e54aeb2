"""The voltage that leads an arm along a course, by inverting its free response."""

from collections.abc import Sequence

from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    start,
    step,
)

TOLERANCE_UM = 1e-4
ROUNDS = 60
REACH_V = 100.0
"""A voltage beyond it is never looked for: no displacement that needs it can be had."""


def free_voltages(
    model: HysteresisModel, displacements_um: Sequence[float], period_s: float
) -> list[float]:
    """Voltages in V, held for a period each, that bring an unpoled arm to displacements in µm.

    The displacement a voltage leads to is continuous in it, and rises over the states that a
    model was identified by. Each is found by false position (Illinois) between two voltages that
    enclose it, to ``TOLERANCE_UM``; where it did not rise, one of several would be found.
    """
    state, voltages = start(model), list[float]()
    for wanted_um in displacements_um:
        state = _reach(model, state, wanted_um, period_s)
        voltages.append(state.voltage_V)
    return voltages


def _reach(
    model: HysteresisModel, state: HysteresisState, wanted_um: float, period_s: float
) -> HysteresisState:
    """State after a period at the voltage that brings a displacement."""
    low = high = step(model, state, state.voltage_V, period_s)
    low_um = high_um = displacement_um(model, low) - wanted_um
    if abs(low_um) <= TOLERANCE_UM:
        return low
    # Enclose it: from the present voltage outwards, in strides that double.
    stride_V = -0.05 if low_um > 0.0 else 0.05
    while low_um * high_um > 0.0:
        low, low_um = high, high_um
        voltage_V = high.voltage_V + stride_V
        if abs(voltage_V) > REACH_V:
            return high
        high = step(model, state, voltage_V, period_s)
        high_um, stride_V = displacement_um(model, high) - wanted_um, 2.0 * stride_V
    found = high
    for _ in range(ROUNDS):
        if low_um == high_um:
            break
        voltage_V = (low.voltage_V * high_um - high.voltage_V * low_um) / (high_um - low_um)
        found = step(model, state, voltage_V, period_s)
        found_um = displacement_um(model, found) - wanted_um
        if abs(found_um) <= TOLERANCE_UM:
            break
        if found_um * high_um < 0.0:
            low, low_um = high, high_um
        else:
            # An end that stays counts half, which ends the crawl of plain false position.
            low_um *= 0.5
        high, high_um = found, found_um
    return found
