"""Compliance from known weights, attached and removed in steps, so that drift and creep cancel.

    x = x_0 - s_p·F + drift·t                                               (55), with its drift

A weight acts in the same direction as a contact force: the arm moves towards smaller x. Weights
that increase and decrease by the same steps are uncorrelated with time, so that the drift does not
affect s_p. Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_not_negative, require_positive

LEAST_STEPS = 4
"""Smallest number of steps: one more than the number of coefficients."""
LEAST_EVENNESS = 0.9
"""Smallest ratio of the compliance under the lightest weights to that under the heaviest."""
SURE = 5.0
"""Smallest difference between the two compliances that is significant, in standard
uncertainties."""


@dataclass(frozen=True, slots=True)
class WeighedCompliance:
    """Compliance s_p with its drift, and the points of the line."""

    compliance_um_per_mN: float
    uncertainty_um_per_mN: float
    """Standard uncertainty, in µm/mN: the larger one of line scatter and reading noise, combined
    with the uncertainty of the weights."""
    rest_um: float
    """Position x_0 without a weight at the first step, in µm."""
    drift_um_per_s: float
    residuals_um: tuple[float, ...]
    weight_mN: NDArray[np.float64]
    sag_um: NDArray[np.float64]
    """Deflection x_0 + drift·t - x at each step, in µm; it lies on a line of slope s_p."""


def weighed_compliance(
    weight_mN: Sequence[float],
    x_um: Sequence[float],
    t_s: Sequence[float],
    *,
    noise_um: float = 0.0,
    weight_uncertainty: float = 0.0,
) -> WeighedCompliance:
    """Return the compliance from the mean positions under weights, and their times.

    Parameters
    ----------
    noise_um
        Standard uncertainty of one mean position, used as a lower bound of the scatter.
    weight_uncertainty
        Relative standard uncertainty that is common to all weights.

    Raises
    ------
    ValueError
        If lengths disagree, there are fewer than ``LEAST_STEPS``, a number is not finite, weight
        and time cannot be distinguished, s_p is not positive, or the compliance is smaller under
        light weights than under heavy ones, as it is while the arm rests against a part.
    """
    F, x, t = (np.asarray(values, dtype=float) for values in (weight_mN, x_um, t_s))
    if not len(F) == len(x) == len(t):
        raise ValueError(
            f"{len(F)} weights, {len(x)} positions, {len(t)} times: must be equal in number"
        )
    if len(F) < LEAST_STEPS:
        raise ValueError(f"{len(F)} steps with weights, must be at least {LEAST_STEPS}")
    if not (np.isfinite(F).all() and np.isfinite(x).all() and np.isfinite(t).all()):
        raise ValueError("a weight, position or time is not finite, all must be")
    require_not_negative("noise", noise_um, "µm")
    require_not_negative("uncertainty of the weights", weight_uncertainty, "")
    elapsed = t - t[0]
    scale_s = max(float(np.max(np.abs(elapsed))), 1e-9)
    columns = np.column_stack([np.ones(len(F)), -F, elapsed / scale_s])
    if np.linalg.matrix_rank(columns) < columns.shape[1]:
        raise ValueError("the weights only increase or are all equal: hang them up and down again")
    solution = np.linalg.lstsq(columns, x, rcond=None)[0]
    residuals = x - columns @ solution
    s_p = require_positive("compliance", float(solution[1]), "µm/mN")
    _require_straight(F, x - columns[:, 2] * solution[2], noise_um)
    scatter = sqrt(float(residuals @ residuals) / (len(F) - columns.shape[1]))
    lever = sqrt(float(np.linalg.inv(columns.T @ columns)[1, 1]))
    by_scatter = max(scatter, noise_um) * lever
    return WeighedCompliance(
        compliance_um_per_mN=s_p,
        uncertainty_um_per_mN=sqrt(by_scatter**2 + (s_p * weight_uncertainty) ** 2),
        rest_um=float(solution[0]),
        drift_um_per_s=float(solution[2]) / scale_s,
        residuals_um=tuple(residuals.tolist()),
        weight_mN=np.asarray(F, dtype=np.float64),
        sag_um=np.asarray(solution[0] + columns[:, 2] * solution[2] - x, dtype=np.float64),
    )


def _require_straight(F: NDArray[np.float64], x: NDArray[np.float64], noise_um: float) -> None:
    """Refuse weights if the light ones deflect the arm less per mN than the heavy ones.

    Two positions under one weight show their repeatability.
    """
    weights = np.unique(F)
    if len(weights) < 3:
        return
    means = [float(np.mean(x[weight == F])) for weight in weights]
    repeats = max(noise_um, *(float(np.std(x[weight == F])) for weight in weights))
    light, heavy = (
        (means[at] - means[at + 1]) / float(weights[at + 1] - weights[at])
        for at in (0, len(weights) - 2)
    )
    sure = SURE * repeats * sqrt(2.0) / float(np.min(np.diff(weights)))
    if light < LEAST_EVENNESS * heavy and heavy - light > sure:
        raise ValueError(
            f"the arm bends by {light:.3f} µm/mN up to {weights[1]:g} mN and by {heavy:.3f} "
            f"µm/mN above {weights[-2]:g} mN: until then a part at {means[0]:.1f} µm seems "
            "to support it: remove it and calibrate again"
        )
