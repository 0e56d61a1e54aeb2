"""Identification of the residual table from runs of a program's voltages without the part.

Runs with the same voltages differ by the sensor's noise and by motion that the arm does not repeat.
These differences determine the smoothing: the width of the Gaussian is chosen so that the smoothed
mean of all runs except one predicts that run best (leave-one-out cross-validation; M. Stone,
Journal of the Royal Statistical Society B 36(2), 1974).
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.response.residual_table import MOST_KNOTS, ResidualTable

WIDTHS = (0.0, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0)
"""Standard deviations of the Gaussian to try, in ticks; 0 for no smoothing."""
REACH = 3.0
"""Distance at which the Gaussian is truncated, in standard deviations."""

Column = NDArray[np.float64]


class Place(NamedTuple):
    """A tick of a program."""

    segment: int
    tick: int


class IdentifiedResidual(NamedTuple):
    """A residual table, and the data of its identification."""

    table: ResidualTable
    width_ticks: float
    """Standard deviation of the smoothing, in ticks."""
    residual_um: Column
    """Smoothed mean of the runs, in µm."""
    error_um: float
    """Standard error of the table in a later run, in µm: the r.m.s. error with which other runs
    predict a run, without the sensor's noise. For n runs its square is multiplied by (n + 1)/(n -
    1)."""


def identify_residual(
    places: Sequence[Place], runs_um: Sequence[Column], noise_um: float
) -> IdentifiedResidual:
    """Return the table from N ticks in the order in which they were played.

    Parameters
    ----------
    places
        Places of the N ticks.
    runs_um
        Residuals of each run, N values per run; at least two runs.
    noise_um
        R.m.s. noise of the sensor, which is not an error of the table.

    Raises
    ------
    ValueError
        If there are fewer than two runs, lengths differ, or the table would be too long.
    """
    runs = np.asarray(runs_um, dtype=np.float64)
    if runs.ndim != 2 or len(runs) < 2 or runs.shape[1] != len(places) or not len(places):
        raise ValueError(f"{runs.shape} residuals of {len(places)} ticks: two runs at least")
    width, missed_um = min(
        ((width, _missed_um(runs, width)) for width in WIDTHS), key=lambda pair: pair[1]
    )
    mean_um = smoothed(np.mean(runs, axis=0), width)
    # The error in a later run consists of the error of the table and the deviation of that run. The
    # prediction above used one run fewer than the table, and the deviation is uncertain if it is
    # computed from few runs.
    few = (len(runs) + 1) / (len(runs) - 1)
    error_um = sqrt(few * max(0.0, missed_um**2 - noise_um**2))
    stride = _stride(width, places)
    table = ResidualTable(stride, _knots(places, mean_um, stride), error_um)
    return IdentifiedResidual(table, width, mean_um, error_um)


def _missed_um(runs: Column, width: float) -> float:
    """Return the r.m.s. difference between each run and the smoothed mean of the others."""
    missed = [
        run - smoothed(np.mean(np.delete(runs, number, axis=0), axis=0), width)
        for number, run in enumerate(runs)
    ]
    return float(np.sqrt(np.mean(np.square(missed))))


def smoothed(values: Column, width_ticks: float) -> Column:
    """Return values smoothed by a Gaussian, which is truncated at the ends of the values."""
    if width_ticks <= 0.0:
        return values
    reach = max(1, round(REACH * width_ticks))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width_ticks) ** 2)
    weight = np.convolve(np.ones(len(values)), kernel)[reach:-reach]
    return np.convolve(values, kernel)[reach:-reach] / weight


def _stride(width: float, places: Sequence[Place]) -> int:
    """Return a stride of half the width; more if the table would be too long to send."""
    segments = 2 * len({place.segment for place in places})
    least = -(-len(places) // max(1, MOST_KNOTS - segments))
    return max(1, int(0.5 * width), least)


def _knots(
    places: Sequence[Place], residual_um: Column, stride: int
) -> tuple[tuple[float, ...], ...]:
    """Return the knots of each segment.

    A tick that was played more than once contributes the mean of its residuals.
    """
    segments = np.array([place.segment for place in places])
    ticks = np.array([place.tick for place in places])
    found: list[tuple[float, ...]] = []
    for segment in range(int(segments.max()) + 1):
        here = segments == segment
        if not here.any():
            found.append(())
            continue
        played, index = np.unique(ticks[here], return_inverse=True)
        means = np.bincount(index, residual_um[here]) / np.bincount(index)
        last = -(-int(played[-1]) // stride) * stride
        at = np.arange(0, last + 1, stride)
        # Round to 0.1 nm, far below the sensor's noise, to make the text of the table short.
        found.append(tuple(np.round(np.interp(at, played, means), 4).tolist()))
    return tuple(found)
