"""What an identified free response gets wrong, from motion it was not fitted to.

Four errors are told apart, in the terms in which the estimator's uncertainty has them: of the
straight line that stands in for x_1 where nothing is identified, as a share of the travel; of
the creep that x_1 does not know, per decade of the age of a zero; of what the actuator forgets
under a small to-and-fro, by its way; and of x_1 itself, as it grows with the voltage's way since
a zero.
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from pincette.control.calibration.free_motion import SecantGain
from pincette.control.calibration.lines import straight_line
from pincette.control.checks import require_as_many, require_not_negative, require_positive
from pincette.control.response.error_growth import ErrorGrowth
from pincette.control.response.hysteresis_motion import Column
from pincette.control.response.reversal_memory import ReversalMemory

ZERO_AFTER_S = 0.4
"""Into a hold, from when its drift counts: as long as a grip rests before its zero."""

SHARES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
"""Of the travel, between which ways count as alike: most of the growth is at short ways."""
LAGS = 12
SHORTEST_S, LONGEST_S = 0.4, 10.0
"""Lags: from the rest of a zero to a slow approach with the load after it."""
BLOCK_S = 0.4
"""Before small swings, over which noise is averaged."""
SCALES_V = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Tried, each twice the one before."""
SCALES_ALIKE = 1.05
"""Ratio of sums of squares."""
LEAST_PAIRS = 100
"""Of samples, below which a way tells nothing."""


class Value(NamedTuple):
    """A number and its standard uncertainty."""

    value: float
    uncertainty: float


def line_error(loops: Sequence[SecantGain]) -> Value:
    """R.m.s. of x - d·(u - u_0) over d·(u - u_0) of settled loops, u_0 their lowest voltage.

    A straight line through a zero there misses both branches; the loops' difference is the
    uncertainty. Raises ValueError where there is no loop.
    """
    shares: list[float] = []
    for loop in loops:
        u, x = loop.voltage_cycle_V, loop.x_cycle_um
        lowest = int(np.argmin(u))
        travel_um = loop.gain_um_per_V * (u - u[lowest])
        error_um = x - x[lowest] - travel_um
        shares.append(sqrt(float(error_um @ error_um) / float(travel_um @ travel_um)))
    return _together("loops", shares, [0.0] * len(shares))


def unknown_creep(left_um: Sequence[Column], period_s: float) -> Value:
    """Drift in µm per decade, b of a + b·log10(1 + t/1 s), of what x_1 leaves in holds.

    Parameters
    ----------
    left_um
        Position less x_1 of each hold; t counts from ``ZERO_AFTER_S`` after its beginning.

    Raises
    ------
    ValueError
        Where there is no hold, or one is too short for a line.
    """
    slopes: list[float] = []
    scatter: list[float] = []
    for left in left_um:
        line = straight_line(
            _decades(len(left), period_s)[round(ZERO_AFTER_S / period_s) :].tolist(),
            left[round(ZERO_AFTER_S / period_s) :].tolist(),
        )
        slopes.append(abs(line.slope))
        scatter.append(line.slope_uncertainty)
    return _together("holds", slopes, scatter)


class Forgetting(NamedTuple):
    """What the actuator forgets under small swings and the model does not, or the reverse."""

    full_um: Value
    """Standard error that x_1 tends to."""
    scale_V: Value
    """Way to and fro at which 63 % of it is reached."""


def unknown_forgetting(
    voltage_V: Column, left_um: Column, period_s: float, swings: Sequence[slice]
) -> Forgetting:
    """Fit r = r(0) + c·(1 - e^(-V/V_s)) to what x_1 leaves under each of several small swings.

    V is the way to and fro, r(0) the mean over the last ``BLOCK_S`` before; one V_s serves all,
    and the root mean square of c is the standard error.

    Parameters
    ----------
    voltage_V, left_um
        N samples of matched ages; position less x_1.
    swings
        The samples of each; before them the voltage rests.

    Raises
    ------
    ValueError
        Where there are none, or the voltage rests in one.
    """
    count = max(1, round(BLOCK_S / period_s))
    ways: list[Column] = []
    moved: list[Column] = []
    for samples in swings:
        memory, way_V = ReversalMemory(float(voltage_V[samples.start - 1])), list[float]()
        for value in voltage_V[samples].tolist():
            memory = memory.follow(value)
            way_V.append(memory.total_V)
        before = left_um[max(0, samples.start - count) : samples.start]
        require_positive("small swings", memory.total_V, "V")
        ways.append(np.array(way_V))
        moved.append(left_um[samples] - float(np.mean(before)))
    fits = [_fitted(ways, moved, scale_V) for scale_V in SCALES_V]
    errors_um, _ = min(fits, key=lambda fit: fit[1])
    lefts = np.array([left for _, left in fits])
    # Scales that leave hardly more than the best one cannot be told from it, nor those between.
    like = np.array(SCALES_V)[lefts <= SCALES_ALIKE * lefts.min()]
    between_V = (float(like[-1]) * sqrt(2.0) - float(like[0]) / sqrt(2.0)) / sqrt(12.0)
    scale = Value(SCALES_V[int(np.argmin(lefts))], between_V)
    # Each is one draw of what it is the standard deviation of.
    return Forgetting(
        _together("small swings", errors_um, [abs(error) / sqrt(2.0) for error in errors_um]), scale
    )


def _fitted(
    ways: Sequence[Column], moved: Sequence[Column], scale_V: float
) -> tuple[list[float], float]:
    """c of each, and the sum of squares that is left of all."""
    errors_um: list[float] = []
    left = 0.0
    for way_V, d_um in zip(ways, moved, strict=True):
        share = -np.expm1(-way_V / scale_V)
        errors_um.append(float(share @ d_um) / float(share @ share))
        left += float(np.sum((d_um - errors_um[-1] * share) ** 2))
    return errors_um, left


def structure_function(
    voltage_V: Sequence[float] | Column,
    left_um: Sequence[float] | Column,
    period_s: float,
    noise_um: float = 0.0,
) -> ErrorGrowth:
    """Growth of the error of x_1, between samples as far apart in time as a zero is from a press.

    Slower errors are creep. Source of the function: A. N. Kolmogorov, Dokl. Akad. Nauk SSSR 30,
    1941.

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


def _decades(samples: int, period_s: float) -> Column:
    """log10(1 + t/1 s); 0 until the zero."""
    t_s = np.arange(samples, dtype=np.float64) * period_s - ZERO_AFTER_S
    return np.log10(1.0 + np.maximum(t_s, 0.0))


def _together(what: str, values: Sequence[float], scatter: Sequence[float]) -> Value:
    """Root mean square of several; uncertain by their scatter and by how they differ."""
    if not values:
        raise ValueError(f"no {what}, one is wanted at least")
    mean = sqrt(float(np.mean(np.square(values))))
    within = sqrt(float(np.mean(np.square(scatter))) / len(values))
    between = float(np.std(values)) / sqrt(max(1, len(values) - 1))
    return Value(mean, sqrt(within**2 + between**2))
