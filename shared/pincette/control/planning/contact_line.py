"""Contact line F = K_e·(x - x_e), identified while the force on a part increases.

The estimated force is computed from the measured position, so that the same noise enters both. A
least-squares fit of F over x then gives a K_e with a relative error of noise²/spread², times 1 +
1/(s_p·K_e). Therefore the planned force F_r, which drives both and has no noise, is used as the
instrumental variable:

    K_e = cov(F, F_r)/cov(x, F_r),    x_e = mean x - mean F/K_e

If the force lags behind the position by τ, K_e is not affected provided that F_r moves
symmetrically in time; x_e changes by τ times the mean speed. Source: T. Söderström and P. Stoica,
Instrumental Variable Methods for System Identification, Springer 1983, chapter 3.
"""

from math import sqrt
from typing import NamedTuple

from pincette.control.record import FrozenRecord


class LoadLine(NamedTuple):
    """Contact line F = K_e·(x - x_e) that references follow."""

    x_e_um: float
    K_e_mN_per_um: float


class ContactFit(NamedTuple):
    """Position of first contact x_e and contact stiffness K_e, with their standard errors.

    The standard errors assume white noise about the line.
    """

    x_e_um: float
    K_e_mN_per_um: float
    x_e_error_um: float
    K_e_error_mN_per_um: float
    scatter_mN: float
    """Standard deviation of F from the line, divided by the square root of the number of samples,
    in mN."""


class ContactLine(FrozenRecord, frozen=True):
    """Running sums of x, F and F_r, relative to the first sample to avoid rounding errors."""

    count: int = 0
    first_x_um: float = 0.0
    first_force_mN: float = 0.0
    first_force_r_mN: float = 0.0
    sum_x: float = 0.0
    sum_F: float = 0.0
    sum_z: float = 0.0
    sum_xz: float = 0.0
    sum_Fz: float = 0.0
    sum_zz: float = 0.0
    sum_xx: float = 0.0
    sum_xF: float = 0.0
    sum_FF: float = 0.0

    def add(self, x_um: float, force_mN: float, force_r_mN: float) -> "ContactLine":
        """Return the line with one more sample: x, F̂ and the corresponding F_r."""
        if self.count == 0:
            return ContactLine(1, x_um, force_mN, force_r_mN)
        x = x_um - self.first_x_um
        F = force_mN - self.first_force_mN
        z = force_r_mN - self.first_force_r_mN
        return ContactLine(
            self.count + 1,
            self.first_x_um,
            self.first_force_mN,
            self.first_force_r_mN,
            self.sum_x + x,
            self.sum_F + F,
            self.sum_z + z,
            self.sum_xz + x * z,
            self.sum_Fz + F * z,
            self.sum_zz + z * z,
            self.sum_xx + x * x,
            self.sum_xF + x * F,
            self.sum_FF + F * F,
        )

    def spread_um(self) -> float:
        """Return the standard deviation of x over the samples."""
        n = self.count
        return sqrt(max(0.0, self.sum_xx / n - (self.sum_x / n) ** 2)) if n else 0.0

    def fit(self, minimum_spread_um: float = 0.1) -> ContactFit | None:
        """Return x_e and K_e.

        Returns None if there are fewer than three samples, if the standard deviation of x along F_r
        is below ``minimum_spread_um``, or if F does not change with F_r, so that no x_e exists.
        """
        n = self.count
        if n < 3:
            return None
        x, F, z = self.sum_x / n, self.sum_F / n, self.sum_z / n
        var_z = self.sum_zz / n - z * z
        cov_xz = self.sum_xz / n - x * z
        cov_Fz = self.sum_Fz / n - F * z
        if var_z <= 0.0 or cov_xz == 0.0 or cov_Fz == 0.0:
            return None
        if not abs(cov_xz) >= minimum_spread_um * sqrt(var_z):
            return None
        K_e = cov_Fz / cov_xz
        x_e = self.first_x_um + x - (self.first_force_mN + F) / K_e
        # Mean square deviation of F from the line, from the means of squares and products.
        var_F, var_x = self.sum_FF / n - F * F, self.sum_xx / n - x * x
        off = var_F - 2.0 * K_e * (self.sum_xF / n - x * F) + K_e * K_e * var_x
        sigma = sqrt(max(0.0, off) / (n - 2))
        slope_error = sigma * sqrt(var_z) / abs(cov_xz)
        lever_um = self.first_x_um + x - x_e
        line_error_um = sqrt(sigma * sigma + (slope_error * lever_um) ** 2) / abs(K_e)
        return ContactFit(x_e, K_e, line_error_um, slope_error, sigma)
