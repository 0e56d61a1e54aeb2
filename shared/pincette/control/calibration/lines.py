"""Straight lines of the calibration: compliance (55), and the line of Fig. 8.

Equation and figure numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. Every result has its
residuals and standard uncertainties. The uncertainties are computed from the scatter alone, and are
valid for independent errors of the samples. For correlated errors, ``correlated_samples`` gives the
factor by which the effective number of samples is smaller.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_not_negative, require_positive


@dataclass(frozen=True, slots=True)
class Line:
    """Line y = slope·x + offset, with x and y in the units of the fitted values."""

    slope: float
    offset: float
    slope_uncertainty: float
    """Standard uncertainty of the slope; infinite for two points, which have no residual."""
    offset_uncertainty: float
    residuals: tuple[float, ...]
    """Difference between y and the line at each point."""

    def at(self, x: float) -> float:
        """Return y of the line at ``x``."""
        return self.slope * x + self.offset


def straight_line(x: Sequence[float], y: Sequence[float]) -> Line:
    """Return the least-squares line of y on x, with errors in y only.

    Raises
    ------
    ValueError
        If lengths disagree, there are fewer than two points, one is not finite, or all x are equal.
    """
    a, b = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if len(a) != len(b):
        raise ValueError(f"{len(a)} values of one quantity for {len(b)} of the other")
    if len(a) < 2:
        raise ValueError(f"{len(a)} points of a line, must be at least 2")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError("a point of a line is not finite, all must be")
    center, spread = float(np.mean(a)), float(np.sum((a - np.mean(a)) ** 2))
    if not spread > (1e-12 * float(np.max(np.abs(a)))) ** 2:
        raise ValueError(f"all {len(a)} points of a line have x = {center}, must differ")
    slope = float(np.sum((a - center) * (b - np.mean(b)))) / spread
    offset = float(np.mean(b)) - slope * center
    residuals = b - slope * a - offset
    freedom = len(a) - 2
    variance = float(np.sum(residuals**2)) / freedom if freedom else inf
    return Line(
        slope=slope,
        offset=offset,
        slope_uncertainty=sqrt(variance / spread),
        offset_uncertainty=sqrt(variance * (1.0 / len(a) + center * center / spread)),
        residuals=tuple(residuals.tolist()),
    )


def correlated_samples(residuals: Sequence[float] | NDArray[np.float64]) -> float:
    """Return the number of successive residuals that count as one independent residual, at least 1.

    τ = 1 + 2·Σ ρ_i, ρ_i = Σ r_k·r_{k+i}/Σ r_k², i = 1, 2, ... while ρ_i > 0

    Errors of the free response are correlated between successive samples, the sensor's noise is
    not. A variance computed for independent errors must be multiplied by τ. Source: C. J. Geyer,
    Practical Markov Chain Monte Carlo, Statistical Science 7(4), 1992.
    """
    r = np.asarray(residuals, dtype=np.float64)
    square = float(r @ r)
    tau = 1.0
    for lag in range(1, len(r)):
        rho = float(r[:-lag] @ r[lag:]) / square if square > 0.0 else 0.0
        if rho <= 0.0:
            break
        tau += 2.0 * rho
    return tau


@dataclass(frozen=True, slots=True)
class Compliance:
    """Compliance s_p of the arm with its uncertainty and its line."""

    compliance_um_per_mN: float
    uncertainty_um_per_mN: float
    residuals_um: tuple[float, ...]


def compliance(
    force_mN: Sequence[float], displacement_um: Sequence[float], noise_um: float = 0.0
) -> Compliance:
    """Return the compliance from known forces at the tip, (55): s_p = Δx/ΔF.

    Parameters
    ----------
    force_mN, displacement_um
        Steady state under each weight, including the unloaded arm with 0 mN. Two points give the
        quotient, more points the least-squares line.
    noise_um
        Standard uncertainty of one displacement. For two points it alone determines the
        uncertainty; for more points it is a lower bound.

    Raises
    ------
    ValueError
        For the reasons given in ``straight_line``, and if s_p is not positive.
    """
    require_not_negative("noise", noise_um, "µm")
    line = straight_line(force_mN, displacement_um)
    s_p = require_positive("compliance", line.slope, "µm/mN")
    by_noise = noise_um / sqrt(float(np.sum((np.asarray(force_mN) - np.mean(force_mN)) ** 2)))
    scatter = 0.0 if line.slope_uncertainty == inf else line.slope_uncertainty
    return Compliance(s_p, max(by_noise, scatter), line.residuals)


def stiffness_line(x_pp_um: Sequence[float], force_pp_mN: Sequence[float]) -> Line:
    """Return the line of Fig. 8: F_pp = K_e·x_pp + offset, in mN over µm.

    ``at`` gives F_pp for an x_pp; in the paper it is 2.47·x_pp - 0.87.

    Raises
    ------
    ValueError
        For the reasons given in ``straight_line``, and if the stiffness is not positive.
    """
    line = straight_line(x_pp_um, force_pp_mN)
    require_positive("stiffness of the line", line.slope, "mN/µm")
    return line
