"""The inverse of the free response: the voltage that leads to a displacement one period ahead.

With H_{k-1}(u) the displacement after a period at u, creep included and with the memory as it
stands at k-1, u = H_{k-1}⁻¹(x) is sought by the secant and, once two voltages enclose it, by false
position (Illinois): G. Dahlquist and Å. Björck, Numerical Methods, Prentice-Hall 1974, section 6.4.
H rises with u, so that there is one u. Two to four evaluations are usual; ``MOST`` bounds them.

The search is a record and a pure step from one evaluation to the next.
"""

from collections.abc import Sequence

from pincette.control.record import FrozenRecord
from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
    displacements_after,
    start,
    step,
)

TOLERANCE_UM = 1e-4
"""Tolerance of the displacement for the voltage that is searched."""
ROUNDS = 60
REACH_V = 100.0
"""A voltage beyond it is never looked for: no displacement that needs it can be had."""
MOST = 16
"""Evaluations after which the last voltage is taken as it is."""
EXTRAPOLATED = 3
"""Evaluations on one side after which the next one goes twice as far, to enclose the voltage."""
LEAST_SLOPE = 0.25
"""Smallest slope of H that an extrapolation assumes, as a share of the mean slope."""


class Search(FrozenRecord, frozen=True):
    """State of the search: two voltages that were tried, with H less the wanted displacement."""

    voltage_V: float
    """Next voltage to try; the result if ``done``."""
    done: bool
    tried: int
    wanted_um: float
    um_per_V: float
    """Mean slope of H."""
    one_V: float
    one_um: float
    other_V: float
    """The one tried last."""
    other_um: float


def begin_search(
    from_V: float, displacement_um: float, wanted_um: float, um_per_V: float
) -> Search:
    """Begin at a voltage in V that leads to ``displacement_um``; ``um_per_V`` is above 0."""
    off_um = displacement_um - wanted_um
    done = abs(off_um) <= TOLERANCE_UM
    voltage_V = from_V if done else from_V - off_um / um_per_V
    return Search(voltage_V, done, 0, wanted_um, um_per_V, from_V, off_um, from_V, off_um)


def go_on(search: Search, displacement_um: float) -> Search:
    """Take in where ``search.voltage_V`` leads."""
    found_V, found_um = search.voltage_V, displacement_um - search.wanted_um
    one_V, one_um = search.other_V, search.other_um
    if search.one_um * search.other_um < 0.0 and not found_um * search.other_um < 0.0:
        # An end that stays counts half, which ends the crawl of plain false position.
        one_V, one_um = search.one_V, 0.5 * search.one_um
    tried = search.tried + 1
    if one_um * found_um < 0.0:
        next_V = (one_V * found_um - found_V * one_um) / (found_um - one_um)
    else:
        slope = max((found_um - one_um) / (found_V - one_V), LEAST_SLOPE * search.um_per_V)
        further = 1.0 if tried < EXTRAPOLATED else 2.0
        next_V = found_V - further * found_um / slope
    done = abs(found_um) <= TOLERANCE_UM or tried >= MOST or next_V == found_V
    return Search(
        found_V if done else next_V,
        done,
        tried,
        search.wanted_um,
        search.um_per_V,
        one_V,
        one_um,
        found_V,
        found_um,
    )


def voltage_for(
    model: HysteresisModel,
    memory: HysteresisState,
    wanted_um: float,
    *,
    um_per_V: float,
    period_s: float,
) -> float:
    """Return the voltage in V that leads from a memory to a displacement in µm, a period ahead.

    Parameters
    ----------
    um_per_V
        Mean slope of the response, above 0, from which the search begins.
    """
    from_V = memory.voltage_V
    displacement_at = displacements_after(model, memory, period_s)
    at_um = displacement_at(from_V)
    search = begin_search(from_V, at_um, wanted_um, um_per_V)
    while not search.done:
        found_um = displacement_at(search.voltage_V)
        search = go_on(search, found_um)
    return search.voltage_V


def free_voltages(
    model: HysteresisModel,
    displacements_um: Sequence[float],
    period_s: float,
    begins: HysteresisState | None = None,
) -> list[float]:
    """Return voltages in V, held for a period each, that bring an arm to displacements in µm.

    ``begins`` is its memory, from whose displacement the others count; None: the arm is unpoled.

    The displacement a voltage leads to is continuous in it, and rises over the states that a
    model was identified by. Each is found by false position (Illinois) between two voltages that
    enclose it, to ``TOLERANCE_UM``; where it did not rise, one of several would be found.
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
    """Return the state after a period at the voltage of a displacement."""
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
