"""The inverse of the free response: the voltage that leads to a displacement one period later.

H_{k-1}(u) is the displacement after a period at u, with creep and with the memory at k-1. The
equation u = H_{k-1}⁻¹(x) is solved by the secant and, once two voltages enclose the solution, by
false position (Illinois): G. Dahlquist and Å. Björck, Numerical Methods, Prentice-Hall 1974,
section 6.4. H rises with u, so that there is one solution. Two to four evaluations are usual;
``MOST`` bounds them.
"""

from collections.abc import Sequence

from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    displacements_after,
    start,
    step,
)

TOLERANCE_UM = 1e-4
"""Tolerance of the displacement for the resulting voltage, in µm."""
ROUNDS = 60
REACH_V = 100.0
"""Bound of the absolute value of the voltages that are searched, in V. Displacements that need more
are treated as impossible."""
MOST = 16
"""Number of evaluations after which the last voltage is accepted."""
EXTRAPOLATED = 3
"""Number of evaluations on one side of the solution after which the next step is doubled, to
enclose the solution."""
LEAST_SLOPE = 0.25
"""Smallest slope of H that an extrapolation assumes, as a fraction of the mean slope."""


def voltage_for(
    model: HysteresisModel,
    memory: HysteresisState,
    wanted_um: float,
    *,
    um_per_V: float,
    period_s: float,
) -> float:
    """Return the voltage in V that leads to a displacement in µm one period later.

    Parameters
    ----------
    um_per_V
        Mean slope of the response, above 0, with which the search begins.
    """
    displacement_at = displacements_after(model, memory, period_s)
    found_V = other_V = memory.voltage_V
    other_um = displacement_at(other_V) - wanted_um
    if abs(other_um) <= TOLERANCE_UM:
        return other_V
    # Two voltages that were tried, each with its error, H minus the wanted displacement;
    # ``other_V`` is the newer one.
    one_V, one_um = other_V, other_um
    next_V = other_V - other_um / um_per_V
    for tried in range(1, MOST + 1):
        found_V, found_um = next_V, displacement_at(next_V) - wanted_um
        if one_um * other_um < 0.0 and not found_um * other_um < 0.0:
            # If an end of the interval does not change, its residual is halved, which is faster
            # than plain false position.
            one_um *= 0.5
        else:
            one_V, one_um = other_V, other_um
        if one_um * found_um < 0.0:
            next_V = (one_V * found_um - found_V * one_um) / (found_um - one_um)
        else:
            slope = max((found_um - one_um) / (found_V - one_V), LEAST_SLOPE * um_per_V)
            further = 1.0 if tried < EXTRAPOLATED else 2.0
            next_V = found_V - further * found_um / slope
        if abs(found_um) <= TOLERANCE_UM or next_V == found_V:
            break
        other_V, other_um = found_V, found_um
    return found_V


def free_voltages(
    model: HysteresisModel,
    displacements_um: Sequence[float],
    period_s: float,
    begins: HysteresisState | None = None,
) -> list[float]:
    """Return voltages in V, held for a period each, that move an arm to displacements in µm.

    ``begins`` is the memory of the arm. Displacements are relative to that of this memory. None:
    the arm is unpoled.

    The displacement is continuous in the voltage, and rises over the states that a model was
    identified from. Each voltage is found by false position (Illinois) between two that enclose it,
    to ``TOLERANCE_UM``. If the displacement does not rise between these two, one of several
    solutions is found.
    """
    state, voltages = start(model) if begins is None else begins, list[float]()
    from_um = displacement_um(model, state)
    for wanted_um in displacements_um:
        state = _reach(model, state, from_um + wanted_um, period_s)
        voltages.append(state.voltage_V)
    return voltages


def _reach(
    model: HysteresisModel, state: HysteresisState, wanted_um: float, period_s: float
) -> HysteresisState:
    """Return the state one period later for a voltage that gives the displacement."""
    low = high = step(model, state, state.voltage_V, period_s)
    low_um = high_um = displacement_um(model, low) - wanted_um
    if abs(low_um) <= TOLERANCE_UM:
        return low
    # Enclose the solution: from the present voltage outwards, in steps that double.
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
            # If an end of the interval does not change, its residual is halved, which is faster
            # than plain false position.
            low_um *= 0.5
        high, high_um = found, found_um
    return found
