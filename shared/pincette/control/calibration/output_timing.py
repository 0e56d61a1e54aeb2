"""Time at which a voltage takes effect, and the mode of the arm, from bursts of voltage steps.

The voltage of tick k is output δ after the sample, and acts on the arm through a first-order lag τ:

    y' = (u - y)/τ,    x'' + 2ζω_n·x' + ω_n²·x = ω_n²·g·y                                     (54)

sampled exactly, as in ``control.arm.sampled_arm``. Higher modes respond quasi-statically, with the
ratio ρ to this mode. A burst is short and excites the mode, so that hysteresis and creep appear as
a slow curve under it:

    x_k = x̄_k(ω_n, ζ, δ, τ; g, gρ) + a cubic for each burst

by least squares in log ω_n, log ζ, D = δ + τ and τ, and by projection for the other parameters. To
first order a lag has the effect of a delay, so that D is determined well. To second order it
affects the gains:

    e^(sτ)/(1 + sτ) = 1 + s²τ²/2 - s³τ³/3 + …,    s²·x = ω_n²·(g·y - x) - 2ζω_n·s·x

Only the third order distinguishes it from a delay, and a lag far below 1/ω_n can hardly be
distinguished from 0. Uncertainties are computed by omitting one burst after the other (jackknife),
so that they contain those errors of the model that differ between bursts. The common error is
bounded by hysteresis: its loss shifts the phase equally at every frequency, by φ_h. At the mode
this looks like a delay of φ_h/ω_n, or like a change of the lag by φ_h·√(1 + ω_n²τ²)/ω_n.

Sources: G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10(2), 1973 (projection); B. Efron, The
Jackknife, SIAM 1982. Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, hypot

import numpy as np
from numpy.typing import NDArray

from pincette.control.calibration.burst_fit import (
    Burst,
    Column,
    PreparedBurst,
    first_mode,
    fit,
    prepared,
    solved,
)
from pincette.control.checks import require_positive

LEAST_BURSTS = 4
LONGEST_DELAY = 1.5
"""Largest delay that is searched, in periods."""
DELAYS = np.arange(0.05, LONGEST_DELAY, 0.1)
LAGS = (0.1, 0.2, 0.35, 0.6, 1.0, 1.6, 2.5, 4.0)
"""Start values of delay and lag, in periods."""
SIGNIFICANT = 4.0
"""Number of standard errors above which a lag counts as present."""
HALVINGS = 6
LOSS_RAD = 0.02
"""Largest phase, in rad, by which the loss in a small hysteresis loop may shift the response of the
mode."""


@dataclass(frozen=True, slots=True)
class IdentifiedTiming:
    """Delay, lag and mode with standard uncertainties, and the fitted samples for a plot."""

    delay_s: float
    delay_uncertainty_s: float
    lag_s: float
    """Time constant τ of the lag, in s; 0 if it is below ``SIGNIFICANT`` standard errors."""
    lag_uncertainty_s: float
    natural_frequency_rad_per_s: float
    natural_frequency_uncertainty_rad_per_s: float
    damping_ratio: float
    damping_ratio_uncertainty: float
    gain_um_per_V: float
    """Gain at the amplitude of the bursts, in µm/V; below d_p because of the hysteresis."""
    moved_um: tuple[Column, ...]
    """Samples of each burst without their slow component, in µm."""
    residual_um: tuple[Column, ...]
    """Residuals of these samples, in µm."""

    @property
    def explained(self) -> float:
        """Return the fraction of the bursts' variance that the fit explains."""
        left = sum(float(one @ one) for one in self.residual_um)
        return 1.0 - left / sum(float(one @ one) for one in self.moved_um)


def output_timing(bursts: Sequence[Burst], period_s: float) -> IdentifiedTiming:
    """Find delay, lag and mode from bursts of a free arm.

    Parameters
    ----------
    bursts
        At least ``LEAST_BURSTS`` bursts with different voltages.

    Raises
    ------
    ValueError
        If there are too few bursts, they show no mode, or the fit does not converge or ends at a
        delay beyond ``LONGEST_DELAY`` periods.
    """
    T = require_positive("period", period_s, "s")
    if len(bursts) < LEAST_BURSTS:
        raise ValueError(f"{len(bursts)} bursts, must be at least {LEAST_BURSTS}")
    some = [prepared(one) for one in bursts]
    without = [[*some[:skip], *some[skip + 1 :]] for skip in range(len(some))]
    found, most = _by_lag(some, T, first_mode(bursts, T))
    lagged = bool(found[3] > 0.0)
    left = np.array([fit(one, T, found, lagged=lagged) for one in without])
    deviation = _jackknife(left)
    lag_s = T * float(found[3])
    omega_n, zeta = exp(float(found[0])), exp(float(found[1]))
    loss_s = LOSS_RAD / omega_n
    if lagged:
        delays = left[:, 2] - left[:, 3]
        # |dG/G| of 1/(1 + jωτ) at the mode is ω·dτ/√(1 + ω²τ²).
        lag_error_s = hypot(T * float(deviation[3]), loss_s * hypot(1.0, omega_n * lag_s))
        delay_error_s = hypot(T * float(_jackknife(delays[:, np.newaxis])[0]), loss_s)
    else:
        lag_error_s = T * most
        delay_error_s = hypot(T * float(deviation[2]), T * most, loss_s)
    delay_s = T * float(found[2]) - lag_s
    if not 0.0 <= delay_s <= LONGEST_DELAY * T:
        raise ValueError(
            f"delay from sample to voltage {1000.0 * delay_s:.3f} ms, must be within 0 and "
            f"{1000.0 * LONGEST_DELAY * T:g} ms: a free arm does not respond like this; "
            "remove what touches it"
        )
    gains, residuals_um = solved(some, T, found)
    ends = np.cumsum([len(one.x_um) for one in some])[:-1]
    return IdentifiedTiming(
        delay_s=delay_s,
        delay_uncertainty_s=delay_error_s,
        lag_s=lag_s,
        lag_uncertainty_s=lag_error_s,
        natural_frequency_rad_per_s=omega_n,
        natural_frequency_uncertainty_rad_per_s=omega_n * float(deviation[0]),
        damping_ratio=zeta,
        damping_ratio_uncertainty=zeta * float(deviation[1]),
        gain_um_per_V=float(np.sum(gains)),
        moved_um=tuple(one.x_um for one in some),
        residual_um=tuple(np.split(residuals_um, ends)),
    )


def _by_lag(some: Sequence[PreparedBurst], period_s: float, mode: Column) -> tuple[Column, float]:
    """Return the best fit, with a lag only if it is significant, and the lag in periods."""

    def squares(at: Column) -> float:
        return float(np.sum(solved(some, period_s, at)[1] ** 2))

    def at(delay: float, lag: float) -> Column:
        return np.array([*mode, delay + lag, lag])

    # Near a lag of 0 the samples hardly depend on it, so that a derivative there is useless.
    prompt = min((at(delay, 0.0) for delay in DELAYS), key=squares)
    behind = min((at(delay, lag) for delay in DELAYS for lag in LAGS), key=squares)
    none = fit(some, period_s, prompt, lagged=False)
    best = fit(some, period_s, behind, lagged=True)
    least = min(squares(best), squares(none))
    variance = least / sum(len(one.x_um) for one in some)
    if squares(none) - squares(best) > SIGNIFICANT**2 * variance:
        return best, 0.0
    low, high = 0.0, 1.0 / float(np.exp(mode[0])) / period_s
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        beside = fit(some, period_s, np.array([*none[:3], middle]), lagged=False)
        told = squares(beside) - least > variance
        low, high = (low, middle) if told else (middle, high)
    return none, high


def _jackknife(left: NDArray[np.float64]) -> Column:
    """Return standard errors from estimates that each omit one burst, shape (bursts, values)."""
    n = len(left)
    deviation = np.sqrt((n - 1.0) / n * np.sum((left - np.mean(left, axis=0)) ** 2, axis=0))
    return np.asarray(deviation)
