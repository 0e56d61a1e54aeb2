"""What an identified free response gets wrong, from motion it was not fitted to.

Two errors are told apart, in the terms in which the estimator's uncertainty has them: of the
straight line that stands in for x_1 where nothing is identified, as a share of the travel; and of
the creep that x_1 does not know, per decade of the age of a zero.
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np

from pincette.control.calibration.free_motion import SecantGain
from pincette.control.calibration.lines import straight_line
from pincette.control.response.hysteresis_motion import Column

ZERO_AFTER_S = 0.4
"""Into a hold, from when its drift counts: as long as a grip rests before its zero."""


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
