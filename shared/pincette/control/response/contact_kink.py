"""Detection of a kink in a free motion that a part in the path of the arm causes.

Beyond x_c, where the arm meets a part of stiffness K, it does not reach its free position f:

    x = f - c·max(0, x - x_c),    c = s_p·K

so the slope beyond x_c is 1/(1 + c) of the slope below it. The kink lies at the same position while
the arm moves up and down, although hysteresis makes f reach it at different voltages. Both facts
are used: f is a linear combination of functions of the voltage (plays, creep, u²) and of x² and x³,
which can represent any smooth curvature of the branches but no kink. A kink is then fitted to the
residual of x at each of many positions, and the best fit is evaluated.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pincette.control.response.hysteresis_motion import Column, low_passed, play_columns
from pincette.control.response.play_fit import (
    PLAYS_PER_FAMILY,
    YIELDING,
    first_known,
    spread_creep_times,
    spread_thresholds,
)

PLACES = 60
"""Number of positions at which a kink is tried, evenly spaced over the range without its ends."""
EDGE = 0.03
"""Fraction of the range at each end in which no kink is tried."""
RIDGE = 1e-6
LEAST_SOFTENING = 0.07
"""Smallest softening c. At 2.17 µm/mN it corresponds to a part of 0.03 mN/µm."""
LEAST_EXPLAINED = 1.12
"""Smallest ratio of the residual's r.m.s. without the kink to that with it. Without a part a kink
reduces it by up to 5 %, whatever the class of hysteresis; with a part by at least 18 %."""


class ContactKink(NamedTuple):
    """A kink in the free response."""

    x_um: float
    """Position x_c of the kink, in µm."""
    voltage_V: float
    """Mean voltage at which the arm reaches ``x_um`` while it moves up, in V."""
    softening: float
    """Softening c = s_p·K, without unit."""

    @property
    def slope_share(self) -> float:
        """Return the ratio of the slope beyond the kink to that before it."""
        return 1.0 / (1.0 + self.softening)


def contact_kink(
    voltage_V: Column, x_um: Column, period_s: float, course: slice | None = None
) -> ContactKink | None:
    """Find the kink in a motion recorded with matched ages; None if none is significant.

    Parameters
    ----------
    voltage_V, x_um
        N samples in V and µm, finite.
    course
        Samples whose voltage range determines the thresholds of the plays. Once the voltage has
        covered this range, the states of the plays are known.
    """
    course = course or slice(len(voltage_V))
    columns, known = _columns(voltage_V, x_um, period_s, course)
    u, x = voltage_V[known:], x_um[known:]
    if len(x) <= columns.shape[1] or not float(np.ptp(x)) > 0.0:
        return None
    across, _ = np.linalg.qr(_ridged(columns))
    left = _projected(across, x[:, np.newaxis])[:, 0]
    places = np.min(x) + np.ptp(x) * np.linspace(EDGE, 1.0 - EDGE, PLACES)
    breaks = _projected(across, np.maximum(0.0, x[:, np.newaxis] - places))
    product, square = -(breaks.T @ left), np.sum(breaks**2, axis=0)
    softening = product / np.maximum(square, np.finfo(float).tiny)
    explained = np.where(softening > 0.0, product * softening, 0.0)
    best = int(np.argmax(explained))
    total = float(left @ left)
    if softening[best] < LEAST_SOFTENING:
        return None
    if total < LEAST_EXPLAINED**2 * (total - float(explained[best])):
        return None
    x_c = float(places[best])
    upwards = (x[:-1] <= x_c) & (x[1:] > x_c)
    return ContactKink(x_c, float(np.mean(u[1:][upwards])), float(softening[best]))


def _columns(
    u: Column, x: Column, period_s: float, course: slice
) -> tuple[NDArray[np.float64], int]:
    """Return the columns whose linear combination represents f, and the first sample with known
    plays.
    """
    thresholds, fadings = [0.0], [0.0]
    travel_V = float(np.ptp(u[course]))
    for share in (0.0, YIELDING):
        family = spread_thresholds(travel_V, share, PLAYS_PER_FAMILY)
        thresholds += family
        fadings += [share / threshold for threshold in family]
    times_s = spread_creep_times(period_s, period_s * len(u))
    creep = low_passed(times_s, u[:, np.newaxis], period_s)[:, :, 0].T
    known = (course.start or 0) + first_known(u[course], max(thresholds))
    bent = (x - np.mean(x)) / max(float(np.ptp(x)), np.finfo(float).tiny)
    plays = play_columns(thresholds, fadings, u)
    columns = np.column_stack([plays, u**2, creep, np.ones(len(u)), bent**2, bent**3])
    return columns[known:], known


def _ridged(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale[scale == 0.0] = 1.0
    penalty = np.sqrt(RIDGE * len(columns)) * np.eye(columns.shape[1])
    return np.vstack([columns / scale, penalty])


def _projected(across: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the components orthogonal to the columns of f; the last rows belong to the ridge."""
    padded = np.vstack([values, np.zeros((len(across) - len(values), values.shape[1]))])
    return padded - across @ (across.T @ padded)
