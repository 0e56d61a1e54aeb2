"""Position at which a closing arm meets a part, from the kink relative to its free response.

With the free response z = x_1 and the distance D = z - x of the arm from it,

    D = D_0 + β·max(0, z - z_e),    β = s_p·K_e/(1 + s_p·K_e),    x_e = z_e - D_0

by least squares in D_0, β, z_e. z is computed from the voltage and does not contain the sensor's
noise, so the right side has no noise. D_0 is the remaining error of the force's zero. The errors of
z are correlated between successive samples, which is included in the uncertainty.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.calibration.lines import correlated_samples
from pincette.control.checks import require_as_many, require_not_negative, require_positive

LEAST_SAMPLES = 30
LEAST_SIDE = 10
"""Smallest number of samples on each side of the kink."""
PLACES = 200
"""Number of kink positions that are tried before the best one is refined."""
ROUNDS = 30
SURE = 5.0
"""Smallest ratio of β to its standard uncertainty."""

Column = NDArray[np.float64]


class NoTouchError(ValueError):
    """Error if no kink in an approach is certain enough to be a contact."""


@dataclass(frozen=True, slots=True)
class FirstTouch:
    """Position and stiffness of a first contact, with data for a plot."""

    contact_um: float
    uncertainty_um: float
    """Standard uncertainty of the position, in µm, from the correlated scatter and from
    ``free_error_um``."""
    stiffness_mN_per_um: float
    """Stiffness over the first µm after the contact, in mN/µm. It is much less certain than that of
    Fig. 8."""
    residual_um: float
    """R.m.s. deviation from the kinked line, in µm."""
    free_um: NDArray[np.float64]
    lack_um: NDArray[np.float64]
    """Difference D between the free response and the position, in µm."""
    fitted_um: NDArray[np.float64]


def first_touch(
    x_um: Sequence[float] | Column,
    force_mN: Sequence[float] | Column,
    compliance_um_per_mN: float,
    free_error_um: float = 0.0,
) -> FirstTouch:
    """Find the first contact in N samples of a slow approach and the start of the press.

    Parameters
    ----------
    x_um, force_mN
        Positions, and the unfiltered force (53) computed with ``compliance_um_per_mN``; the free
        response follows from both, x_1 = x + s_p·F̂.
    free_error_um
        Standard error of x_1 between two voltages. A kink in the model of this size cannot be
        distinguished from one of the arm.

    Raises
    ------
    NoTouchError
        If no kink is found within the samples.
    ValueError
        If lengths disagree, there are fewer than ``LEAST_SAMPLES``, or one is not finite.
    """
    s_p = require_positive("compliance", compliance_um_per_mN, "µm/mN")
    require_not_negative("error of the free response", free_error_um, "µm")
    x, F = np.asarray(x_um, dtype=float), np.asarray(force_mN, dtype=float)
    require_as_many("positions", x, "forces", F)
    if len(x) < LEAST_SAMPLES:
        raise ValueError(f"{len(x)} samples of an approach, must be at least {LEAST_SAMPLES}")
    if not (np.isfinite(x).all() and np.isfinite(F).all()):
        raise ValueError("a sample of the approach is not finite, all must be")
    lack = np.asarray(s_p * F, dtype=np.float64)
    z = np.asarray(x + lack, dtype=np.float64)
    ordered = np.sort(z)
    low, high = float(ordered[LEAST_SIDE - 1]), float(ordered[-LEAST_SIDE])
    step = (high - low) / PLACES
    places = low + step * np.arange(PLACES + 1)
    best = int(np.argmin([_fit(z, lack, place)[1] for place in places.tolist()]))
    kink = _refined(z, lack, max(low, places[best] - step), min(high, places[best] + step))
    (offset, slope), square = _fit(z, lack, kink)
    fitted = np.asarray(offset + slope * np.maximum(0.0, z - kink), dtype=np.float64)
    variance = correlated_samples((lack - fitted)[np.argsort(z)]) * square / (len(z) - 3)
    columns = np.column_stack([np.ones(len(z)), np.maximum(0.0, z - kink), -slope * (z > kink)])
    covariance = variance * np.linalg.pinv(columns.T @ columns)
    if not (0.0 < slope < 1.0 and slope > SURE * sqrt(float(covariance[1, 1]))):
        raise NoTouchError(
            f"beyond x_1 = {kink:.3f} µm the arm moves less than freely by a share of "
            f"{slope:.3f} ± {sqrt(float(covariance[1, 1])):.3f}: no significant touch within "
            "the approach"
        )
    # x_e = z_e - D_0.
    across = np.array([-1.0, 0.0, 1.0])
    return FirstTouch(
        contact_um=kink - offset,
        uncertainty_um=sqrt(float(across @ covariance @ across) + free_error_um**2),
        stiffness_mN_per_um=slope / ((1.0 - slope) * s_p),
        residual_um=sqrt(square / len(z)),
        free_um=z,
        lack_um=lack,
        fitted_um=fitted,
    )


def _fit(z: Column, lack: Column, kink: float) -> tuple[tuple[float, float], float]:
    """Return D_0 and β for a kink position, and the sum of squared residuals."""
    beyond = np.maximum(0.0, z - kink)
    about = beyond - np.mean(beyond)
    spread = float(about @ about)
    slope = float(about @ lack) / spread if spread > 0.0 else 0.0
    offset = float(np.mean(lack)) - slope * float(np.mean(beyond))
    left = lack - offset - slope * beyond
    return (offset, slope), float(left @ left)


def _refined(z: Column, lack: Column, low: float, high: float) -> float:
    """Return the kink position with the least sum of squares in an interval, by ternary search."""
    for _ in range(ROUNDS):
        third = (high - low) / 3.0
        if _fit(z, lack, low + third)[1] < _fit(z, lack, high - third)[1]:
            high -= third
        else:
            low += third
    return 0.5 * (low + high)
