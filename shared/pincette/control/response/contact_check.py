"""Check of a residual table with a pressed part that was not used to make the table.

The force of a pressed part is a smooth function of the position. The estimated force scatters about
that function because of errors of the free response, so a valid table reduces the scatter. An error
proportional to the position cannot be detected: it has the same effect as another stiffness.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

DEGREE = 2
"""Degree of the polynomial that represents the force over the position. The stiffness of a round
face increases with the force."""
LEAST_SAMPLES = 40
"""Smallest number of samples for the check."""
LEAST_SWING_MN = 2.0
"""Smallest swing of the force, in mN. A part held at a constant force does not show how the force
depends on the position."""
CHANCE = 2.0
"""Largest increase of a mean square that counts as chance, in standard deviations."""


class ContactScatter(NamedTuple):
    """R.m.s. deviation of the force from a smooth function of the position, in mN."""

    without_mN: float
    """Scatter of the force estimated without the table, in mN."""
    with_mN: float
    """Scatter of the force corrected by the table, in mN."""
    samples: int

    @property
    def worse(self) -> bool:
        """Return whether the table increases the scatter by more than chance may cause."""
        allowed = 1.0 + CHANCE * sqrt(2.0 / self.samples)
        return self.with_mN**2 > allowed * self.without_mN**2


def contact_scatter(
    x_um: ArrayLike, force_mN: ArrayLike, correction_mN: ArrayLike
) -> ContactScatter | None:
    """Return the scatter of pressed samples; None if they are too few or the force hardly changes.

    Parameters
    ----------
    correction_mN
        Correction of each sample's force by the table.
    """
    x, force = np.asarray(x_um, np.float64), np.asarray(force_mN, np.float64)
    if len(x) < LEAST_SAMPLES or float(np.ptp(force)) < LEAST_SWING_MN:
        return None
    corrected = force + np.asarray(correction_mN, np.float64)
    return ContactScatter(_scatter_mN(x, force), _scatter_mN(x, corrected), len(x))


def _scatter_mN(x_um: np.ndarray, force_mN: np.ndarray) -> float:
    terms = np.vander((x_um - x_um.mean()) / np.ptp(x_um), DEGREE + 1)
    fitted, *_ = np.linalg.lstsq(terms, force_mN, rcond=None)
    squares = np.sum((force_mN - terms @ fitted) ** 2)
    return float(np.sqrt(squares / (len(x_um) - DEGREE - 1)))
