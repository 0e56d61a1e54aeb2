"""The rising branch of a conditioned arm, measured as a correction of the identified model.

Each recorded motion begins with conditioning strokes. Staircases of rests give the table of the
correction. Grips rehearsed without a part are not used for the table; they give its error and the
repeatability of the motion.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import sqrt
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from pincette.control.response.conditioned_branch import ConditionedBranch
from pincette.control.response.error_growth import ErrorGrowth, widening
from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import Column
from pincette.control.response.identified_response import identified_response
from pincette.control.response.model_errors import (
    REST_S,
    RehearsedGrip,
    rehearsed_errors,
    return_error,
)

SETTLED = 0.5
"""Fraction of a rest, at its end, over which the position is averaged."""
LEAST_S = 0.1
"""Shortest rest that is evaluated, in s."""
LEAST_WAY_UM = 2.0
"""Shortest motion that is used to compute the repeatability, in µm."""
APART_V = 0.01
"""Smallest difference between two voltages of the table, in V."""


class ConditionedWay(NamedTuple):
    """Samples of a motion that begins with conditioning strokes."""

    strokes: slice
    """Strokes and the rest after them."""
    stairs: slice | None
    """Rests on the rising branch; None for a rehearsed grip."""
    grip: RehearsedGrip | None
    """Rehearsed grip; None for a staircase."""


class MeasuredBranch(NamedTuple):
    """The rising branch of a conditioned arm, and the error of the model after a return."""

    branch: ConditionedBranch
    return_error_um: float | None
    """Error of x_1 in µm when the arm returns to the position of its zero; see ``return_error``."""


class Rest(NamedTuple):
    """Mean values over the end of a rest."""

    voltage_V: float
    left_um: float
    """Position minus model, in µm."""
    model_um: float
    samples: int


def measured_branch(
    model: HysteresisModel,
    voltage_V: Column,
    x_um: Column,
    period_s: float,
    ways: Sequence[ConditionedWay],
) -> MeasuredBranch | None:
    """Return the rising branch, or None without staircases or without rehearsed grips.

    After the strokes the plays of the model are set to those of a poled arm, whatever their states
    were before. The estimator does the same. The creep states continue.

    Parameters
    ----------
    voltage_V, x_um
        N samples of matched ages.
    ways
        Motions that begin with conditioning strokes.
    """
    if not ways:
        return None
    model_um = _modelled_um(model, voltage_V, period_s, ways)
    left_um = x_um - model_um
    bottoms = [_bottom(voltage_V, left_um, model_um, period_s, way) for way in ways]
    rested = [_rests(voltage_V, left_um, model_um, period_s, way.strokes)[-1] for way in ways]
    stairs: list[list[Rest]] = []
    for way, bottom in zip(ways, bottoms, strict=True):
        if way.stairs is None:
            continue
        whole = slice(way.strokes.start, way.stairs.stop)
        rests = _rests(voltage_V, left_um, model_um, period_s, whole)
        place = max(index for index, rest in enumerate(rests) if rest == bottom)
        stairs.append(
            [rest._replace(left_um=rest.left_um - bottom.left_um) for rest in rests[place:]]
        )
    grips = [
        (way, way.grip, bottom, rest)
        for way, bottom, rest in zip(ways, bottoms, rested, strict=True)
        if way.grip is not None
    ]
    if not stairs or not grips:
        return None
    voltages_V, added_um = _table(stairs)
    noise_um = _noise_um(left_um[ways[0].strokes])
    uneven_um = _uneven_um(stairs, noise_um)
    spread = _way_spread(stairs, noise_um)
    strokes = _arrivals(voltage_V[grips[0][0].strokes], voltages_V[0])
    nothing_um = (0.0,) * len(added_um)
    # The table is kept only if it reduces the error in grips that were not used to make it.
    judged = [
        _judged(
            ConditionedBranch(
                voltages_V,
                table_um,
                ErrorGrowth((1.0,), (0.0,)),
                way_spread=spread,
                strokes=strokes,
            ),
            (voltage_V, x_um, left_um),
            period_s,
            grips,
            uneven_um,
        )
        for table_um in (added_um, nothing_um)
    ]
    best = min(
        judged,
        key=lambda found: widening(found.branch.rehearsals) * found.branch.errors.errors_um[1],
    )
    branch = _with_rests(best.branch, list(zip(bottoms, rested, strict=True)))
    return best._replace(branch=branch)


def _with_rests(branch: ConditionedBranch, ways: Sequence[tuple[Rest, Rest]]) -> ConditionedBranch:
    """Return the branch with the ratio of the motion from the lowest voltage to the next rest."""
    ratios = [
        _apart_um(bottom, rest) / (rest.model_um - bottom.model_um + branch.at(rest.voltage_V))
        for bottom, rest in ways
    ]
    return replace(
        branch, rest_ratio=float(np.mean(ratios)), rest_spread=float(np.std(ratios, ddof=1))
    )


def _judged(
    branch: ConditionedBranch,
    columns: tuple[Column, Column, Column],
    period_s: float,
    grips: Sequence[tuple[ConditionedWay, RehearsedGrip, Rest, Rest]],
    uneven_um: float,
) -> MeasuredBranch:
    """Return the branch with its errors and motion ratios, computed from rehearsed grips.

    No error is below ``uneven_um``.
    """
    voltage_V, x_um, left_um = columns
    model_um = x_um - left_um
    remaining_um = left_um.copy()
    ratios: dict[float, float] = {}
    ways_um: list[float] = []
    for way, grip, bottom, rest in grips:
        from_k = way.strokes.stop
        to_k = grip.press.stop if grip.let_go is None else grip.let_go.stop
        tops_V = np.maximum.accumulate(voltage_V[from_k:to_k])
        table_um = np.array([branch.at(top_V) for top_V in tops_V.tolist()])
        remaining_um[from_k:to_k] -= bottom.left_um + table_um
        zero = _rests(voltage_V, left_um, model_um, period_s, grip.approach)[-1]
        top_V = float(np.max(voltage_V[grip.approach]))
        modelled_um = zero.model_um - rest.model_um + branch.at(top_V) - branch.at(rest.voltage_V)
        way_um = _apart_um(rest, zero)
        ratios[zero.voltage_V] = way_um / modelled_um
        ways_um.append(abs(way_um))
    rehearsed = [grip for _, grip, _, _ in grips]
    growth = rehearsed_errors(
        voltage_V, remaining_um, period_s, rehearsed, through_hold=True
    ).growth
    places_V = tuple(sorted(ratios))
    measured = replace(
        branch,
        errors=growth,
        rehearsals=len(grips),
        places_V=places_V,
        way_ratios=tuple(ratios[place_V] for place_V in places_V),
        way_uneven=sqrt(2.0) * uneven_um / float(np.mean(ways_um)),
    )
    return MeasuredBranch(
        measured.at_least(uneven_um), return_error(x_um, remaining_um, period_s, rehearsed)
    )


def _uneven_um(stairs: Sequence[Sequence[Rest]], noise_um: float) -> float:
    """Return the standard error of the position between two rests of a staircase, in µm.

    It is computed from the deviation of each rest from the line through its two neighbours. Arms
    whose hysteresis consists of few large relays move in jumps, which a table of a few rests does
    not reproduce.
    """
    rows = [[(rest.voltage_V, rest.left_um) for rest in one] for one in stairs]
    off2_um2 = [
        (x - x_1 - (x_2 - x_1) * (u - u_1) / (u_2 - u_1)) ** 2
        for row in rows
        for (u_1, x_1), (u, x), (u_2, x_2) in zip(row[1:], row[2:], row[3:], strict=False)
        if u_2 > u_1
    ]
    samples = min(rest.samples for one in stairs for rest in one)
    mean_um2 = float(np.mean(off2_um2)) if off2_um2 else 0.0
    return sqrt(max(0.0, mean_um2 - 1.5 * noise_um**2 / samples))


def _way_spread(stairs: Sequence[Sequence[Rest]], noise_um: float) -> float:
    """Return the relative standard deviation between repetitions of a conditioned motion.

    The motions begin at the rest after the strokes, which is the second rest of each staircase.
    """
    ratios2: list[float] = []
    for (_, base, *one), (_, other_base, *other) in pairwise(stairs):
        for first, second in zip(one, other, strict=False):
            way_um = _apart_um(base, first)
            if first.voltage_V == second.voltage_V and abs(way_um) > LEAST_WAY_UM:
                apart_um = way_um - _apart_um(other_base, second)
                noise_um2 = 4.0 * noise_um**2 / min(first.samples, second.samples)
                ratios2.append((apart_um**2 - noise_um2) / (2.0 * way_um**2))
    return sqrt(max(0.0, float(np.mean(ratios2)))) if ratios2 else 0.0


def _apart_um(begin: Rest, end: Rest) -> float:
    return end.left_um + end.model_um - begin.left_um - begin.model_um


def _modelled_um(
    model: HysteresisModel, voltage_V: Column, period_s: float, ways: Sequence[ConditionedWay]
) -> Column:
    """Return the displacement of the model in µm, with its plays set by each motion's strokes."""
    strokes = voltage_V[ways[0].strokes]
    low_V, high_V = float(np.min(strokes)), float(np.max(voltage_V))
    nothing = ConditionedBranch(
        (low_V, high_V),
        (0.0, 0.0),
        ErrorGrowth((1.0,), (0.0,)),
        strokes=_arrivals(strokes, low_V),
    )
    response = identified_response(model, 1.0, 0.0, branch=nothing)
    found = np.empty(len(voltage_V))
    for place, at_V in enumerate(voltage_V.tolist()):
        response = response.updated(at_V, period_s)
        found[place] = response.calibrated_um()
    return found


def _arrivals(voltage_V: Column, low_V: float) -> int:
    """Return how often the voltage comes down to ``low_V``, within 5 % of ``low_V``."""
    low = np.concatenate([[False], voltage_V <= 0.95 * low_V])
    return int(np.sum(~low[:-1] & low[1:]))


def _table(stairs: Sequence[Sequence[Rest]]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the mean table of several staircases, at the voltages of the first one."""
    voltages_V = [rest.voltage_V for rest in stairs[0]]
    each = [
        np.interp(voltages_V, [rest.voltage_V for rest in one], [rest.left_um for rest in one])
        for one in stairs
    ]
    added_um = np.mean(each, axis=0).tolist()
    kept = [0]
    for place in range(1, len(voltages_V)):
        if voltages_V[place] - voltages_V[kept[-1]] > APART_V:
            kept.append(place)
    return tuple(voltages_V[k] for k in kept), tuple(float(added_um[k]) for k in kept)


def _bottom(u: Column, left: Column, model: Column, period_s: float, way: ConditionedWay) -> Rest:
    """Return the rest at the lowest voltage of the last stroke."""
    rests = _rests(u, left, model, period_s, way.strokes)
    low_V = min(rest.voltage_V for rest in rests)
    return [rest for rest in rests if rest.voltage_V <= low_V + APART_V][-1]


def _rests(u: Column, left: Column, model: Column, period_s: float, samples: slice) -> list[Rest]:
    """Return mean values over the end of each rest of the voltage in a range of samples."""
    still = np.concatenate([[False], np.diff(u[samples]) == 0.0])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    found: list[Rest] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        count = int(end - begin)
        if count * period_s < LEAST_S:
            continue
        used = min(max(1, round(SETTLED * count)), max(1, round(REST_S / period_s)))
        part = slice(samples.start + int(end) - used, samples.start + int(end))
        found.append(
            Rest(
                float(np.mean(u[part])),
                float(np.mean(left[part])),
                float(np.mean(model[part])),
                used,
            )
        )
    return found


def _noise_um(left: Column) -> float:
    """Return the standard deviation of the noise of one sample, in µm."""
    return float(np.median(np.abs(np.diff(left)))) / (0.6745 * sqrt(2.0))
