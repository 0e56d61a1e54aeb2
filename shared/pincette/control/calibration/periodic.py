"""Cycle and peak-to-peak value of a periodic motion in a noisy record.

    value(t) = mean + drift·t + Σ a_k·cos kωt + b_k·sin kωt,  k = 1 … HARMONICS

by least squares. With hysteresis a cycle is not described by a single harmonic. The difference
between the largest and the smallest reading would grow with the noise and with the length of the
record; the peak-to-peak value of the fitted cycle does not. The remaining bias of the extremes by
noise, Var(slope)/|curvature| in total, is subtracted.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]

HARMONICS = 9
POINTS = 720
"""Number of points at which the cycle is evaluated."""
LEAST_SAMPLES_PER_CYCLE = 4 * HARMONICS
LEAST_CYCLES = 2.0


@dataclass(frozen=True, slots=True)
class Periodic:
    """A periodic motion, in the unit of the recorded values."""

    mean: float
    peak_to_peak: float
    peak_to_peak_uncertainty: float
    """Standard uncertainty from the scatter alone, valid for independent errors of the samples."""
    residual: float
    """R.m.s. residual of the fit."""
    cycle: Column
    """One fitted cycle of ``POINTS`` values that begins at the first sample, relative to the
    mean."""

    @property
    def lowest(self) -> float:
        """Return the smallest value of the fitted cycle, including the mean of the record."""
        return self.mean + float(self.cycle.min())


def periodic(values: Sequence[float] | Column, samples_per_cycle: float) -> Periodic:
    """Fit a periodic motion to evenly spaced samples.

    Raises
    ------
    ValueError
        If there are less than ``LEAST_CYCLES`` cycles or ``LEAST_SAMPLES_PER_CYCLE`` samples in
        each, or a sample is not finite.
    """
    y = np.asarray(values, dtype=float)
    if not samples_per_cycle >= LEAST_SAMPLES_PER_CYCLE:
        raise ValueError(
            f"{samples_per_cycle:g} samples per cycle, must be at least {LEAST_SAMPLES_PER_CYCLE}"
        )
    # Cycles may end between samples, so a record that is half a sample short counts as complete.
    if not len(y) >= LEAST_CYCLES * samples_per_cycle - 0.5:
        raise ValueError(
            f"{len(y) / samples_per_cycle:.2f} cycles, must be at least {LEAST_CYCLES:g}"
        )
    if not np.isfinite(y).all():
        raise ValueError("a sample of the cycles is not finite, all must be")
    phase = np.arange(len(y), dtype=np.float64) * (2.0 * pi / samples_per_cycle)
    drift = np.linspace(-1.0, 1.0, len(y))
    columns = np.column_stack([np.ones(len(y)), drift, _waves(phase)])
    solution = np.linalg.lstsq(columns, y, rcond=None)[0]
    residuals = y - columns @ solution
    variance = float(residuals @ residuals) / (len(y) - columns.shape[1])
    waves = _waves(np.arange(POINTS, dtype=np.float64) * (2.0 * pi / POINTS))
    cycle = np.asarray(waves @ solution[2:], dtype=np.float64)
    top, bottom = int(np.argmax(cycle)), int(np.argmin(cycle))
    covariance = variance * np.linalg.inv(columns.T @ columns)[2:, 2:]
    across = waves[top] - waves[bottom]
    peak_to_peak = float(cycle[top] - cycle[bottom])
    return Periodic(
        mean=float(solution[0]),
        peak_to_peak=peak_to_peak - _noise_bias(peak_to_peak, variance, len(y)),
        peak_to_peak_uncertainty=sqrt(float(across @ covariance @ across)),
        residual=sqrt(float(np.mean(residuals**2))),
        cycle=cycle,
    )


def _waves(phase: Column) -> Column:
    """Return cosines and sines of all harmonics, N × 2·HARMONICS."""
    angles = phase[:, np.newaxis] * np.arange(1, HARMONICS + 1)
    return np.asarray(np.hstack([np.cos(angles), np.sin(angles)]), dtype=np.float64)


def _noise_bias(peak_to_peak: float, variance: float, count: int) -> float:
    """Return the bias of both extremes by noise, Var(slope)/|curvature| of the first harmonic."""
    if not peak_to_peak > 0.0:
        return 0.0
    squares = float(np.sum(np.arange(1, HARMONICS + 1) ** 2))
    return min(peak_to_peak, 2.0 * variance / count * squares / (0.5 * peak_to_peak))
