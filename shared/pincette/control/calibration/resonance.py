"""Least-squares fit of the second-order model (54) to a frequency response.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. With ω_n in rad/s and d_p in µm/V

    X/U = d_p·ω_n²/(s² + 2·ζ·ω_n·s + ω_n²)                                               (54)

Far below their own resonance, higher modes of an arm respond like a spring, with a constant ratio
ρ. Their response is small compared with the resonance, but shifts the flanks of the peak, which
determine ω_n and ζ: if the second mode of a cantilever is neglected, ζ is wrong by some percent.

    X/U = d_p/(1 + ρ)·[1/(1 - r² + 2·j·ζ·r) + ρ],    r = ω/ω_n

Sources: D. W. Marquardt, SIAM Journal 11(2), 1963, for the method; D. J. Ewins, Modal Testing,
Research Studies Press 2000, section 4.2, for the residual of modes out of range.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_as_many, require_positive

LEAST_POINTS = 10
LEAST_PEAK = 2.0
"""Smallest ratio of the gain at the peak to that at low frequency; below it ω_n and ζ cannot be
determined separately."""
ROUNDS = 60
SETTLED = 1e-10


@dataclass(frozen=True, slots=True)
class SecondOrder:
    """Model (54) with standard uncertainties, and the residuals of the natural log of |gain|.

    The uncertainties are computed from the scatter alone, and are valid for independent points.
    """

    natural_frequency_rad_per_s: float
    damping_ratio: float
    gain_um_per_V: float
    """Gain d_p of all modes together, in µm/V."""
    natural_frequency_uncertainty_rad_per_s: float
    damping_ratio_uncertainty: float
    gain_uncertainty_um_per_V: float
    residuals: tuple[float, ...]
    higher_modes: float = 0.0
    """Ratio ρ of the static deflection in higher modes to that in this mode."""
    higher_modes_uncertainty: float = 0.0

    def gain_at(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the complex gain of the model in µm/V at frequencies in Hz."""
        values, _ = _dynamics(self.natural_frequency_rad_per_s, self.damping_ratio, frequency_hz)
        scale = self.gain_um_per_V / (1.0 + self.higher_modes)
        return np.asarray(scale * (1.0 / values + self.higher_modes), dtype=np.complex128)


def fit_second_order(
    frequency_hz: Sequence[float] | NDArray[np.float64],
    gain_um_per_V: Sequence[complex] | NDArray[np.complex128],
    *,
    to_hz: float,
    log_gain_uncertainty: Sequence[float] | NDArray[np.float64] | None = None,
    higher_modes: bool = False,
) -> SecondOrder:
    """Fit (54) to a frequency response up to ``to_hz`` by least squares of log|gain|.

        log|X/U| = log g + log|1 + ρ·D| - log|D|,    D = 1 - r² + 2·j·ζ·r,    d_p = g·(1 + ρ)

    The parameters log ω_n, log ζ, log g, and ρ if ``higher_modes`` is true, are found by the
    Levenberg-Marquardt method; otherwise ρ is 0. Only magnitudes are used, since delays of output
    and sensor affect only the phase. ``log_gain_uncertainty`` gives the weights of the points.

    Raises
    ------
    ValueError
        If lengths disagree, there are fewer than ``LEAST_POINTS`` points, one is not finite or not
        positive, no resonance lies within the frequencies, or the fit does not converge.
    """
    f, gain = np.asarray(frequency_hz, dtype=float), np.abs(np.asarray(gain_um_per_V))
    require_as_many("frequencies", f, "gains", gain)
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
    count = 4 if higher_modes else 3
    parameters = _first_guess(f, gain, to_hz)
    target = np.log(gain)
    values, slopes = _log_gain(parameters, f, count)
    residuals = weights * (target - values)
    damping = 1e-3
    for _ in range(ROUNDS):
        scaled = slopes * weights[:, np.newaxis]
        norms = np.sqrt(np.sum(scaled**2, axis=0))
        stacked = np.vstack([scaled, np.diag(sqrt(damping) * norms)])
        step = np.linalg.lstsq(stacked, np.concatenate([residuals, np.zeros(count)]), rcond=None)[0]
        tried = parameters.copy()
        tried[:count] += step
        values, tried_slopes = _log_gain(tried, f, count)
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
    omega_n, zeta, gain_1 = np.exp(parameters[:3]).tolist()
    rho = float(parameters[3])
    d_p = require_positive("gain of all modes", gain_1 * (1.0 + rho), "µm/V")
    if not 2.0 * pi * float(f.min()) < omega_n < 2.0 * pi * float(f.max()):
        raise ValueError(f"resonance at {omega_n / (2.0 * pi):.1f} Hz, must be within the sweep")
    scaled = slopes * weights[:, np.newaxis]
    variance = float(np.sum(residuals**2)) / (len(f) - count)
    covariance = variance * np.linalg.inv(scaled.T @ scaled)
    deviations = np.sqrt(np.diag(covariance)).tolist()
    # d_p = g·(1 + ρ); log g is fitted.
    across = np.array([0.0, 0.0, 1.0, 1.0 / (1.0 + rho)])[:count]
    return SecondOrder(
        natural_frequency_rad_per_s=omega_n,
        damping_ratio=zeta,
        gain_um_per_V=d_p,
        natural_frequency_uncertainty_rad_per_s=omega_n * deviations[0],
        damping_ratio_uncertainty=zeta * deviations[1],
        gain_uncertainty_um_per_V=d_p * sqrt(float(across @ covariance @ across)),
        residuals=tuple((residuals / weights).tolist()),
        higher_modes=rho,
        higher_modes_uncertainty=deviations[3] if higher_modes else 0.0,
    )


def _first_guess(
    f: NDArray[np.float64], gain: NDArray[np.float64], to_hz: float
) -> NDArray[np.float64]:
    """Return start values of log ω_n, log ζ, log g and ρ, from the peak and the lowest fifth."""
    peak = int(np.argmax(gain))
    order = np.argsort(f)
    low = float(np.median(gain[order[: max(3, len(f) // 5)]]))
    height = float(gain[peak]) / low
    if height < LEAST_PEAK or peak in (int(order[0]), int(order[-1])):
        raise ValueError(
            f"no resonance up to {to_hz} Hz: the gain at {f[peak]:.1f} Hz is {height:.2f} "
            f"times that at low frequency, a peak of at least {LEAST_PEAK} must be within "
            "the sweep"
        )
    return np.array([*np.log([2.0 * pi * float(f[peak]), 0.5 / height, low]), 0.0])


def _dynamics(
    omega_n: float, zeta: float, f: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return D = 1 - r² + 2·j·ζ·r, and r."""
    r = 2.0 * pi * f / omega_n
    return np.asarray(1.0 - r * r + 2j * zeta * r, dtype=np.complex128), r


def _log_gain(
    parameters: NDArray[np.float64], f: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return log|X/U| and its derivatives by the first ``count`` parameters, N and N × count."""
    omega_n, zeta = np.exp(parameters[:2]).tolist()
    rho = float(parameters[3])
    D, r = _dynamics(omega_n, zeta, f)
    values = parameters[2] + np.log(np.abs(1.0 + rho * D)) - np.log(np.abs(D))
    # d log|1 + ρD| - d log|D| = Re[(ρ/(1 + ρD) - 1/D)·dD].
    by_D = rho / (1.0 + rho * D) - 1.0 / D
    over_omega = np.real(by_D * (2.0 * r * r - 2j * zeta * r))
    over_zeta = np.real(by_D * 2j * zeta * r)
    over_rho = np.real(D / (1.0 + rho * D))
    slopes = np.column_stack([over_omega, over_zeta, np.ones(len(f)), over_rho])
    return values, slopes[:, :count]
