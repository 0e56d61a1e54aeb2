"""How the error of a model of the free response grows with the way of the voltage since a zero.

A zero takes off what the model errs by there; what it errs by later is a difference of two errors,

    E(w) = √⟨[r(t) - r(t_0)]²⟩  over all t, t_0 with |u(t) - u(t_0)| = w,    r = x - x_1

which is the root of the structure function of what the model leaves. It is found of motion that
the model was not fitted to, between samples as far apart in time as a zero is from a press: slower
errors are creep, which the estimator states apart. Source of the function:
A. N. Kolmogorov, Dokl. Akad. Nauk SSSR 30, 1941.
"""

from collections.abc import Sequence
from itertools import pairwise
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_as_many, require_not_negative, require_positive

SHARES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
"""Of the travel, between which ways count as alike: most of the growth is at short ways."""
LAGS = 12
SHORTEST_S, LONGEST_S = 0.4, 10.0
"""Lags: from the rest of a zero to a slow approach with the load after it."""
LEAST_PAIRS = 100
"""Of samples, below which a way tells nothing."""


class ErrorGrowth(NamedTuple):
    """E(w) at some ways; straight lines between, from 0 at 0, level beyond the last."""

    ways_V: tuple[float, ...]
    """Rising, above 0."""
    errors_um: tuple[float, ...]
    """Standard; never falling."""

    def at(self, way_V: float) -> float:
        """Standard error in µm of x_1 that far from the zero."""
        from_V = from_um = 0.0
        for to_V, to_um in zip(self.ways_V, self.errors_um, strict=True):
            if way_V <= to_V:
                return from_um + (to_um - from_um) * (way_V - from_V) / (to_V - from_V)
            from_V, from_um = to_V, to_um
        return from_um


def checked_growth(ways_V: Sequence[float], errors_um: Sequence[float]) -> ErrorGrowth:
    """Growth from numbers that were stored.

    Raises
    ------
    ValueError
        Where lengths disagree, there are none, ways do not rise from above 0, or errors fall.
    """
    require_as_many("ways of the voltage", ways_V, "errors", errors_um)
    if not ways_V:
        raise ValueError("0 ways of the voltage, must be at least 1")
    for name, values, least in (("way", (0.0, *ways_V), 1e-9), ("error", (0.0, *errors_um), 0.0)):
        for before, after in pairwise(values):
            if not after - before >= least:
                raise ValueError(f"{name} {after:g} follows {before:g}, must rise from 0")
    return ErrorGrowth(tuple(ways_V), tuple(errors_um))


def error_growth(
    voltage_V: Sequence[float] | NDArray[np.float64],
    left_um: Sequence[float] | NDArray[np.float64],
    period_s: float,
    noise_um: float = 0.0,
) -> ErrorGrowth:
    """Structure function of what a model leaves of motion that it was not fitted to.

    Parameters
    ----------
    voltage_V, left_um
        N samples of matched ages; the offset of ``left_um`` does not matter.
    noise_um
        Standard deviation of the sensor's, which is stated apart: 2·noise² is taken off.

    Raises
    ------
    ValueError
        Where lengths disagree, the voltage rests, or the record is too short for any way.
    """
    u, r = np.asarray(voltage_V, dtype=np.float64), np.asarray(left_um, dtype=np.float64)
    require_as_many("voltages", u, "residuals", r)
    require_positive("period", period_s, "s")
    require_not_negative("noise", noise_um, "µm")
    travel_V = require_positive("travel of the voltage", float(np.ptp(u)) if len(u) else 0.0, "V")
    edges_V = travel_V * np.array(SHARES)
    cells = len(SHARES) - 1
    squares, ways, pairs = np.zeros(cells), np.zeros(cells), np.zeros(cells)
    lags = np.unique(np.round(np.geomspace(SHORTEST_S, LONGEST_S, LAGS) / period_s).astype(int))
    for lag in lags[(lags > 0) & (lags < len(u))].tolist():
        way = np.abs(u[lag:] - u[:-lag])
        cell = np.clip(np.searchsorted(edges_V, way, side="right") - 1, 0, cells - 1)
        squares += np.bincount(cell, (r[lag:] - r[:-lag]) ** 2, cells)
        ways += np.bincount(cell, way, cells)
        pairs += np.bincount(cell, minlength=cells)
    ways_V: list[float] = []
    errors_um: list[float] = []
    largest_um = 0.0
    for square, way, count in zip(squares.tolist(), ways.tolist(), pairs.tolist(), strict=True):
        if count >= LEAST_PAIRS and way > 0.0:
            largest_um = max(largest_um, sqrt(max(0.0, square / count - 2.0 * noise_um**2)))
            ways_V.append(way / count)
            errors_um.append(largest_um)
    if not ways_V:
        raise ValueError(f"{len(u)} samples are too few to tell how an error grows")
    return ErrorGrowth(tuple(ways_V), tuple(errors_um))
