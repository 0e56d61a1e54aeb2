"""Noise of a position sensor from readings of an arm at rest.

Let d_k be x_{k+1} - x_k minus the mean of these differences. White noise then has σ² = ½·mean(d²);
a drift that is slow compared with the period has no effect. The uncertainty of σ is computed from
the spread of d², so that it is valid for quantised readings as well as for Gaussian ones. Source of
the estimator: J. von Neumann, Annals of Mathematical Statistics 12(4), 1941.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.calibration.lines import straight_line
from pincette.control.checks import require_not_negative, require_positive

LEAST_READINGS = 100
COVERED = 6.6
"""Width of the interval that contains 99.9 % of Gaussian readings, in standard deviations."""
QUANTISED = 0.5
"""Ratio of noise to quantisation step below which the readings are not Gaussian: they take only one
or two values."""
SAME = 1e-9
"""Largest difference between two readings that count as equal, in µm; it allows for rounding."""
SETTLED_FILTERS = 5.0
"""Number of time constants after which the initial state of the filter no longer matters."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the readings; in µm, except for the drift."""

    noise_um: float
    """R.m.s. of the white noise, in µm, including that of quantisation."""
    noise_uncertainty_um: float
    """Standard uncertainty of the noise from the scatter alone, in µm."""
    spread_um: float
    """R.m.s. deviation from the drift, in µm; larger than the noise if the readings contain slow
    motion."""
    step_um: float
    """Smallest difference between two readings, in µm."""
    quantised: bool
    """True if the quantisation step hides the noise; the noise is then mainly that of the step."""
    resolution_um: float
    """Smallest motion that a reading can show, in µm: 6.6·σ, or the whole width of quantised
    readings."""
    filtered_noise_um: float
    """R.m.s. noise after the filter of the law, in µm."""
    filtered_resolution_um: float
    """Smallest motion that a filtered reading can show, in µm: 6.6 times the filtered noise."""
    drift_um_per_s: float
    drift_uncertainty_um_per_s: float
    """Standard uncertainty of the drift, in µm/s, valid for independent scatter of the readings."""
    t_s: NDArray[np.float64]
    deviation_um: NDArray[np.float64]
    """Readings minus the drift, in µm."""


def sensor_noise(
    x_um: Sequence[float] | NDArray[np.float64], period_s: float, filter_s: float = 0.0
) -> Noise:
    """Return the noise of readings at a constant voltage, one reading per period.

    Parameters
    ----------
    filter_s
        Time constant of the law's first-order low-pass; 0 for none.

    Raises
    ------
    ValueError
        If there are fewer than ``LEAST_READINGS``, one is not finite, or all are equal.
    """
    x = np.asarray(x_um, dtype=float)
    require_positive("period", period_s, "s")
    require_not_negative("filter", filter_s, "s")
    if len(x) < LEAST_READINGS:
        raise ValueError(f"{len(x)} readings of the noise, must be at least {LEAST_READINGS}")
    if not np.isfinite(x).all():
        raise ValueError("a reading is not finite, all must be")
    gaps = np.diff(np.unique(x))
    gaps = gaps[gaps > SAME]
    if not len(gaps):
        raise ValueError(
            f"all {len(x)} readings are {x[0]:g} µm: noise below the sensor's step cannot be "
            "measured, nor can a stuck sensor be recognized; choose a finer display"
        )
    t = np.arange(len(x)) * period_s
    line = straight_line(t.tolist(), x.tolist())
    deviation = np.asarray(line.residuals, dtype=np.float64)
    noise_um, uncertainty_um = _white(deviation)
    step_um = float(np.min(gaps))
    quantised = noise_um < QUANTISED * step_um
    share = 1.0 - exp(-period_s / filter_s) if filter_s > 0.0 else 1.0
    skipped = min(len(x) // 2, round(SETTLED_FILTERS * filter_s / period_s))
    filtered_um = float(np.std(_filtered(deviation, share)[skipped:]))
    width_um = float(np.ptp(x)) if quantised else COVERED * noise_um
    return Noise(
        noise_um=noise_um,
        noise_uncertainty_um=uncertainty_um,
        spread_um=sqrt(float(deviation @ deviation) / (len(x) - 2)),
        step_um=step_um,
        quantised=quantised,
        resolution_um=max(step_um, width_um),
        filtered_noise_um=filtered_um,
        filtered_resolution_um=max(step_um if quantised else 0.0, COVERED * filtered_um),
        drift_um_per_s=line.slope,
        drift_uncertainty_um_per_s=line.slope_uncertainty,
        t_s=np.asarray(t, dtype=np.float64),
        deviation_um=deviation,
    )


def _white(deviation: NDArray[np.float64]) -> tuple[float, float]:
    """Return σ from successive differences, and its standard uncertainty."""
    differences = np.diff(deviation)
    squares = (differences - np.mean(differences)) ** 2
    sigma = sqrt(0.5 * float(np.mean(squares)))
    # Successive differences share a reading, so their squares are correlated.
    about = squares - np.mean(squares)
    spread = float(about @ about) + 2.0 * float(about[1:] @ about[:-1])
    return sigma, 0.25 * sqrt(max(0.0, spread)) / (len(squares) * sigma)


def _filtered(values: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    out, value = np.empty(len(values)), 0.0
    for index, taken in enumerate(values.tolist()):
        value += share * (taken - value)
        out[index] = value
    return out
