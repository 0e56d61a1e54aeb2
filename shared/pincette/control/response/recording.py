"""Branches of the free response, recorded in a free motion, and their error."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_as_many
from pincette.control.response.hysteresis_motion import Column
from pincette.control.response.recorded_response import RecordedBranches, Turn, recorded_response

CELLS = 24
HELD_OUT = 0.25
"""Fraction of the samples, at the end of the record, over which the residual is computed. The mean
of the residual is subtracted."""
END = 0.03
"""Fraction of the voltage range: a stroke is complete if it ends this near to the end of the range,
and the voltage may reverse by this much within a stroke."""
MIN_SAMPLES_PER_CELL = 2
LEAST_RISE = 1e-3
"""Smallest rise of a cell, as a fraction of its width; otherwise noise could make it fall."""


class Recording(NamedTuple):
    """Branches, and their r.m.s. error in µm over samples that were not used for them."""

    branches: RecordedBranches
    residual_um: float


def record_free_response(voltage_V: Sequence[float], x_um: Sequence[float]) -> Recording:
    """Return the branches from those strokes of a free motion that cover the whole voltage range.

    Parameters
    ----------
    voltage_V, x_um
        N samples in V and µm, of matched ages as for ``identify_free_response``.

    Raises
    ------
    ValueError
        If the lengths differ, a sample is not finite, the samples that are used contain no stroke
        up or no stroke down over the whole range, or they are too few.
    """
    u, x = np.asarray(voltage_V, dtype=float), np.asarray(x_um, dtype=float)
    require_as_many("voltages", u, "positions", x)
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise ValueError("a sample is not finite, all must be")
    taken = int(len(u) * (1.0 - HELD_OUT))
    branches = recorded_branches(u[:taken], x[:taken])
    response, followed = recorded_response(branches, 1.0, 0.0), list[float]()
    for voltage in u.tolist():
        response = response.updated(voltage, 0.0)
        followed.append(response.displacement_um())
    return Recording(branches, float(np.std((x - np.asarray(followed))[taken:])))


def recorded_branches(voltage_V: Column, x_um: Column) -> RecordedBranches:
    """Return the mean branches of all complete strokes; raises ValueError without a stroke."""
    if len(voltage_V) < 2 or not float(np.ptp(voltage_V)) > 0.0:
        raise ValueError(f"{len(voltage_V)} samples of a voltage at rest, a stroke is needed")
    shapes: list[tuple[float, ...]] = []
    ends: list[NDArray[np.float64]] = []
    for name, sign in (("up", 1.0), ("down", -1.0)):
        strokes = _strokes(sign * voltage_V)
        if not strokes:
            raise ValueError(f"no stroke {name} over the {np.ptp(voltage_V):.3f} V of the motion")
        ways: list[Column] = []
        for first, last in strokes:
            u, x = voltage_V[first : last + 1], x_um[first : last + 1]
            if len(u) < MIN_SAMPLES_PER_CELL * CELLS:
                raise ValueError(
                    f"{len(u)} samples in a stroke {name}, {MIN_SAMPLES_PER_CELL * CELLS} "
                    "are needed"
                )
            way = (u - u[0]) / (u[-1] - u[0])
            knots = _knots(way, x)
            ways.append((knots - knots[0]) / (knots[-1] - knots[0]))
            points = np.array([[u[0], knots[0]], [u[-1], knots[-1]]])
            ends.append(points if sign > 0.0 else points[::-1])
        shapes.append(_rising(np.mean(ways, axis=0)))
    bottom, top = np.mean(ends, axis=0).tolist()
    return RecordedBranches(Turn(*bottom), Turn(*top), shapes[0], shapes[1])


def _strokes(u: Column) -> list[tuple[int, int]]:
    """Return the first and last sample of each rise from a low end to a high end of the range."""
    low, high = float(u.min()), float(u.max())
    margin = END * (high - low)
    strokes: list[tuple[int, int]] = []
    begun: int | None = None
    ended: int | None = None
    furthest = low
    for index, value in enumerate(u.tolist()):
        if value <= low + margin:
            # A stroke begins at the last of the lowest samples of a rest.
            if begun is None or ended is not None or value <= u[begun]:
                begun, ended = index, None
            furthest = value
        elif begun is not None:
            if value < furthest - margin:
                begun = None
                continue
            if value >= high - margin:
                if ended is None:
                    strokes.append((begun, index))
                    ended = index
                elif value > u[ended]:
                    strokes[-1] = (begun, index)
                    ended = index
            furthest = max(furthest, value)
    return strokes


def _knots(way: Column, x: Column) -> Column:
    """Return the values of the best-fitting piecewise linear function at evenly spaced knots."""
    place = np.clip(way, 0.0, 1.0) * CELLS
    cell = np.minimum(place.astype(int), CELLS - 1)
    hats = np.zeros((len(way), CELLS + 1))
    rows = np.arange(len(way))
    hats[rows, cell] = 1.0 - (place - cell)
    hats[rows, cell + 1] = place - cell
    # The knot of a cell without samples is interpolated between its neighbours.
    bend = 1e-3 * np.diff(np.eye(CELLS + 1), n=2, axis=0)
    stacked = np.vstack([hats, bend])
    target = np.concatenate([x, np.zeros(CELLS - 1)])
    knots = np.linalg.lstsq(stacked, target, rcond=None)[0]
    return np.asarray(knots, dtype=np.float64)


def _rising(shape: Column) -> tuple[float, ...]:
    """Return a shape that rises strictly from 0 to 1, changed as little as needed."""
    rises = np.maximum(np.diff(shape), LEAST_RISE / CELLS)
    values = np.concatenate([[0.0], np.cumsum(rises)]) / np.sum(rises)
    return (0.0, *values[1:-1].tolist(), 1.0)
