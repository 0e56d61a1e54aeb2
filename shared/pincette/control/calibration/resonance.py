"""The second-order model (54) of a frequency response, by least squares.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. With ω_n in rad/s and d_p in µm/V

    X/U = d_p·ω_n²/(s² + 2·ζ·ω_n·s + ω_n²)                                               (54)

Source of the method: D. W. Marquardt, SIAM Journal 11(2), 1963.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_positive

LEAST_POINTS = 10
LEAST_PEAK = 2.0
"""Of the gain over that at low frequency; below, ω_n and ζ are hardly to be told apart."""
ROUNDS = 60
SETTLED = 1e-10


@dataclass(frozen=True, slots=True)
class SecondOrder:
    """Model (54) with standard uncertainties, and the residuals of the natural log of |gain|."""

    natural_frequency_rad_per_s: float
    damping_ratio: float
    gain_um_per_V: float
    """d_p."""
    natural_frequency_uncertainty_rad_per_s: float
    damping_ratio_uncertainty: float
    gain_uncertainty_um_per_V: float
    residuals: tuple[float, ...]


def fit_second_order(
    frequency_hz: Sequence[float] | NDArray[np.float64],
    gain_um_per_V: Sequence[complex] | NDArray[np.complex128],
    *,
    to_hz: float,
    log_gain_uncertainty: Sequence[float] | NDArray[np.float64] | None = None,
) -> SecondOrder:
    """Fit (54) to a frequency response up to ``to_hz`` by least squares of log|gain|.

        log|X/U| = log d_p - ½·log[(1 - r²)² + (2·ζ·r)²],    r = ω/ω_n

    by Levenberg and Marquardt in log ω_n, log ζ, log d_p. Magnitudes alone will do; delays of
    output and sensor, which turn the phase, do not disturb. With ``log_gain_uncertainty`` points
    weigh by it.

    Raises
    ------
    ValueError
        Where lengths disagree, there are fewer than ``LEAST_POINTS`` points, one is not finite or
        not positive, no resonance stands within the frequencies, or the fit does not settle.
    """
    f, gain = np.asarray(frequency_hz, dtype=float), np.abs(np.asarray(gain_um_per_V))
    if len(f) != len(gain):
        raise ValueError(f"{len(f)} frequencies for {len(gain)} gains, must be as many")
    kept = f <= require_positive("end of the fit", to_hz, "Hz")
    f, gain = f[kept], gain[kept]
    if len(f) < LEAST_POINTS:
        raise ValueError(f"{len(f)} points up to {to_hz} Hz, must be at least {LEAST_POINTS}")
    if not (
        np.isfinite(f).all() and np.isfinite(gain).all() and (f > 0).all() and (gain > 0).all()
    ):
        raise ValueError("a frequency or a gain is not finite and above 0, all must be")
    weights = np.ones(len(f))
    if log_gain_uncertainty is not None:
        stated = np.asarray(log_gain_uncertainty, dtype=float)[kept]
        weights = 1.0 / np.maximum(stated, max(1e-6, 0.1 * float(np.median(stated))))
        weights /= sqrt(float(np.mean(weights**2)))
    parameters = _first_guess(f, gain, to_hz)
    target = np.log(gain)
    values, slopes = _log_gain(parameters, f)
    residuals = weights * (target - values)
    damping = 1e-3
    for _ in range(ROUNDS):
        scaled = slopes * weights[:, np.newaxis]
        norms = np.sqrt(np.sum(scaled**2, axis=0))
        stacked = np.vstack([scaled, np.diag(sqrt(damping) * norms)])
        step = np.linalg.lstsq(stacked, np.concatenate([residuals, np.zeros(3)]), rcond=None)[0]
        tried = parameters + step
        values, tried_slopes = _log_gain(tried, f)
        tried_residuals = weights * (target - values)
        if float(np.sum(tried_residuals**2)) <= float(np.sum(residuals**2)):
            parameters, slopes, residuals = tried, tried_slopes, tried_residuals
            damping = max(1e-12, 0.1 * damping)
            if float(np.max(np.abs(step))) < SETTLED:
                break
        else:
            damping *= 10.0
            if damping > 1e12:
                break
    else:
        raise ValueError(f"the fit of the resonance has not settled in {ROUNDS} rounds")
    omega_n, zeta, d_p = np.exp(parameters).tolist()
    if not 2.0 * pi * float(f.min()) < omega_n < 2.0 * pi * float(f.max()):
        raise ValueError(f"resonance at {omega_n / (2.0 * pi):.1f} Hz, must be within the sweep")
    scaled = slopes * weights[:, np.newaxis]
    variance = float(np.sum(residuals**2)) / (len(f) - 3)
    deviations = np.sqrt(variance * np.diag(np.linalg.inv(scaled.T @ scaled))).tolist()
    return SecondOrder(
        natural_frequency_rad_per_s=omega_n,
        damping_ratio=zeta,
        gain_um_per_V=d_p,
        natural_frequency_uncertainty_rad_per_s=omega_n * deviations[0],
        damping_ratio_uncertainty=zeta * deviations[1],
        gain_uncertainty_um_per_V=d_p * deviations[2],
        residuals=tuple((residuals / weights).tolist()),
    )


def _first_guess(
    f: NDArray[np.float64], gain: NDArray[np.float64], to_hz: float
) -> NDArray[np.float64]:
    """Logs of ω_n, ζ and d_p: from the peak, its height, and the lowest fifth."""
    peak = int(np.argmax(gain))
    order = np.argsort(f)
    low = float(np.median(gain[order[: max(3, len(f) // 5)]]))
    height = float(gain[peak]) / low
    if height < LEAST_PEAK or peak in (int(order[0]), int(order[-1])):
        raise ValueError(
            f"no resonance up to {to_hz} Hz: the gain at {f[peak]:.1f} Hz is {height:.2f} times "
            f"that at low frequency, a peak of {LEAST_PEAK} must stand within the sweep"
        )
    return np.log([2.0 * pi * float(f[peak]), 0.5 / height, low])


def _log_gain(
    parameters: NDArray[np.float64], f: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """log|X/U| and its slopes over the three parameters, N and N × 3."""
    omega_n, zeta, _ = np.exp(parameters)
    r2 = (2.0 * pi * f / omega_n) ** 2
    square = (1.0 - r2) ** 2 + 4.0 * zeta * zeta * r2
    values = parameters[2] - 0.5 * np.log(square)
    over_omega = (-2.0 * r2 * (1.0 - r2) + 4.0 * zeta * zeta * r2) / square
    over_zeta = -4.0 * zeta * zeta * r2 / square
    return values, np.column_stack([over_omega, over_zeta, np.ones(len(f))])
