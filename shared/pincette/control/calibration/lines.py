"""Straight lines of the calibration: compliance (55), the plan's line of Fig. 8, and contact.

Equation and figure numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. Every result carries its
residuals and standard uncertainties; those are of the scatter alone, and hold for errors that are
independent from sample to sample.
Source of the instrumental variable: R. J. Bowden and D. A. Turkington, Instrumental Variables,
Cambridge 1984, chapter 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_not_negative, require_positive

LEAST_CORRELATION = 0.9
"""Of x with x_1 over a press; below, the press is too small for its noise."""
LEAST_CONTACT_SAMPLES = 10


@dataclass(frozen=True, slots=True)
class Line:
    """y = slope·x + offset; x and y in the units of what was fitted."""

    slope: float
    offset: float
    slope_uncertainty: float
    """Standard uncertainty; infinite where two points leave nothing to judge by."""
    offset_uncertainty: float
    covariance: float
    """Of slope and offset."""
    residuals: tuple[float, ...]
    """y less the line, point by point."""

    def at(self, x: float) -> float:
        """Return the line's y at ``x``."""
        return self.slope * x + self.offset

    def uncertainty_at(self, x: float) -> float:
        """Return the standard uncertainty of the line's y at ``x``; infinite with two points."""
        if self.slope_uncertainty == inf:
            return inf
        square = x * x * self.slope_uncertainty**2 + self.offset_uncertainty**2
        return sqrt(max(0.0, square + 2.0 * x * self.covariance))


def straight_line(x: Sequence[float], y: Sequence[float]) -> Line:
    """Least squares of y on x, with errors in y alone.

    Raises
    ------
    ValueError
        Where lengths disagree, there are fewer than two points, one is not finite, or all x are
        the same.
    """
    a, b = _pair(x, y, 2)
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
        covariance=-center * variance / spread if freedom else 0.0,
        residuals=tuple(residuals.tolist()),
    )


@dataclass(frozen=True, slots=True)
class Compliance:
    """s_p of the arm."""

    compliance_um_per_mN: float
    uncertainty_um_per_mN: float
    residuals_um: tuple[float, ...]


def compliance(
    force_mN: Sequence[float], displacement_um: Sequence[float], noise_um: float = 0.0
) -> Compliance:
    """Compliance from known forces at the tip, (55): s_p = Δx/ΔF.

    Parameters
    ----------
    force_mN, displacement_um
        Steady state under each weight, the unloaded arm among them with its 0 mN. Two give the
        quotient, more the least-squares line.
    noise_um
        Standard uncertainty of one displacement; what the uncertainty of two points is made of,
        and the least that of more is.

    Raises
    ------
    ValueError
        As ``straight_line``, and where s_p is not positive.
    """
    require_not_negative("noise", noise_um, "µm")
    line = straight_line(force_mN, displacement_um)
    s_p = require_positive("compliance", line.slope, "µm/mN")
    by_noise = noise_um / sqrt(float(np.sum((np.asarray(force_mN) - np.mean(force_mN)) ** 2)))
    scatter = 0.0 if line.slope_uncertainty == inf else line.slope_uncertainty
    return Compliance(s_p, max(by_noise, scatter), line.residuals)


def stiffness_line(x_pp_um: Sequence[float], force_pp_mN: Sequence[float]) -> Line:
    """Line of Fig. 8: F_pp = K_e·x_pp + offset, in mN over µm.

    ``at`` plans F_pp for an x_pp: the paper's 2.47·x_pp - 0.87.

    Raises
    ------
    ValueError
        As ``straight_line``, and where the stiffness is not positive.
    """
    line = straight_line(x_pp_um, force_pp_mN)
    require_positive("stiffness of the line", line.slope, "mN/µm")
    return line


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact line F = K_e·(x - x_e), with standard uncertainties."""

    stiffness_mN_per_um: float
    stiffness_uncertainty_mN_per_um: float
    contact_um: float
    """x_e."""
    contact_uncertainty_um: float
    residuals_mN: tuple[float, ...]
    """F less the line."""


def contact_line(
    x_um: Sequence[float], force_mN: Sequence[float], free_um: Sequence[float]
) -> Contact:
    """Contact line of a press on a part, with the free response x_1 as instrument.

        K_e = cov(F, x_1)/cov(x, x_1),    x_e = mean(x) - mean(F)/K_e

    F̂ = (x_1 - x)/s_p is made of the same x, and the sensor's noise enters both, with -1/s_p
    between them: regressing F̂ on x is biased towards that. x_1 moves with the press and knows
    nothing of the noise.

    Parameters
    ----------
    x_um, force_mN, free_um
        N samples in contact of position, unfiltered force (53) and free response.

    Raises
    ------
    ValueError
        Where lengths disagree, there are fewer than ``LEAST_CONTACT_SAMPLES``, one is not finite,
        x does not follow x_1, or K_e is not positive.
    """
    x, F = _pair(x_um, force_mN, LEAST_CONTACT_SAMPLES)
    _, z = _pair(x_um, free_um, LEAST_CONTACT_SAMPLES)
    dx, dF, dz = x - np.mean(x), F - np.mean(F), z - np.mean(z)
    xz, zz, xx = float(np.sum(dx * dz)), float(np.sum(dz * dz)), float(np.sum(dx * dx))
    correlation = xz / sqrt(xx * zz) if xx > 0.0 and zz > 0.0 else 0.0
    if not correlation >= LEAST_CORRELATION:
        raise ValueError(
            f"correlation of x with x_1 = {correlation:.3f}, must be at least "
            f"{LEAST_CORRELATION}: the press is too small for its noise"
        )
    K_e = require_positive("contact stiffness", float(np.sum(dF * dz)) / xz, "mN/µm")
    residuals = dF - K_e * dx
    variance = float(np.sum(residuals**2)) / (len(x) - 2)
    u_K = sqrt(variance * zz) / xz
    x_e = float(np.mean(x)) - float(np.mean(F)) / K_e
    # x_e = mean(x) - mean(F)/K_e: the mean of the residuals, and the lever of K_e's error.
    lever_um = float(np.mean(F)) / K_e
    u_x_e = sqrt(variance / len(x) + (lever_um * u_K) ** 2) / K_e
    return Contact(K_e, u_K, x_e, u_x_e, tuple(residuals.tolist()))


def _pair(
    x: Sequence[float], y: Sequence[float], least: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    a, b = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if len(a) != len(b):
        raise ValueError(f"{len(a)} values of one quantity for {len(b)} of the other")
    if len(a) < least:
        raise ValueError(f"{len(a)} points of a line, must be at least {least}")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError("a point of a line is not finite, all must be")
    return a, b
