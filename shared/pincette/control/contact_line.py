"""The contact line F = K_e·(x - x_e), fitted while the arm is pressed on."""

from dataclasses import dataclass
from typing import NamedTuple


class ContactFit(NamedTuple):
    """Position of first touch x_e and contact stiffness K_e."""

    x_e_um: float
    K_e_mN_per_um: float


@dataclass(frozen=True, slots=True)
class ContactLine:
    """Running least squares of F on x, with sums counted from the first sample.

    The shift keeps the sums small beside the spread, so that nothing cancels. Noise of x lowers
    K_e by the share noise²/spread²; where F is estimated from the same x the slope errs further,
    hence the fit is worth something only over a spread far above the noise.
    """

    count: int = 0
    first_x_um: float = 0.0
    first_force_mN: float = 0.0
    sum_x: float = 0.0
    sum_F: float = 0.0
    sum_xx: float = 0.0
    sum_xF: float = 0.0

    def add(self, x_um: float, force_mN: float) -> "ContactLine":
        """Return the line with one more sample in it."""
        if self.count == 0:
            return ContactLine(1, x_um, force_mN)
        x = x_um - self.first_x_um
        F = force_mN - self.first_force_mN
        return ContactLine(
            self.count + 1,
            self.first_x_um,
            self.first_force_mN,
            self.sum_x + x,
            self.sum_F + F,
            self.sum_xx + x * x,
            self.sum_xF + x * F,
        )

    def fit(self, minimum_spread_um: float = 0.1) -> ContactFit | None:
        """Return x_e and K_e.

        None where x has a standard deviation below ``minimum_spread_um``, where there are fewer
        than three samples, or where F does not change with x, so that no x_e exists.
        """
        if self.count < 3:
            return None
        mean_x = self.sum_x / self.count
        mean_F = self.sum_F / self.count
        variance = self.sum_xx / self.count - mean_x * mean_x
        if not variance >= minimum_spread_um * minimum_spread_um or variance <= 0.0:
            return None
        K_e = (self.sum_xF / self.count - mean_x * mean_F) / variance
        if K_e == 0.0:
            return None
        x_e = self.first_x_um + mean_x - (self.first_force_mN + mean_F) / K_e
        return ContactFit(x_e, K_e)
