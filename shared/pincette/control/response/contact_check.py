"""Check of a residual table against a pressed part that it was not made from.

Where a part is pressed, its force is a smooth function of the position. The estimate of the force
scatters about that function by the error of the free response, so a valid table makes the scatter
smaller. An error in proportion to the position cannot be detected: it looks like another stiffness.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

DEGREE = 2
"""Degree of the polynomial for the force over the position: a round face becomes stiffer."""
LEAST_SAMPLES = 40
"""Fewest samples that allow a judgement."""
LEAST_SWING_MN = 2.0
"""Least swing of the force, in mN: a part that is held at rest shows no function."""
CHANCE = 2.0
"""Increase of a mean square that chance explains, in standard deviations."""


class ContactScatter(NamedTuple):
    """R.m.s. of the force about a smooth function of the position, in mN."""

    without_mN: float
    """Scatter of the force as estimated without the table, in mN."""
    with_mN: float
    """Scatter of the force as corrected by the table, in mN."""
    samples: int

    @property
    def worse(self) -> bool:
        """Return whether the table increases the scatter by more than chance explains."""
        allowed = 1.0 + CHANCE * sqrt(2.0 / self.samples)
        return self.with_mN**2 > allowed * self.without_mN**2


def contact_scatter(
    x_um: ArrayLike, force_mN: ArrayLike, correction_mN: ArrayLike
) -> ContactScatter | None:
    """Return the scatter of pressed samples; None if they are too few or hardly move.

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
