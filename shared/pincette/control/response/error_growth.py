"""Growth of a free response model's error with the voltage travel since a zero.

A zero removes the error that the model has at that moment. The later error is a difference of two
errors,

    E(w) = √⟨[r(t) - r(t_0)]²⟩,    |u(t) - u(t_0)| = w,    r = x - x_1

as a mean over grips rehearsed without a part, where t_0 is the time at which the force would be
zeroed. ``model_errors.rehearsed_errors`` computes it, the estimator uses it.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from pincette.control.checks import require_as_many

COVERAGE = 2.0
"""Coverage factor of an uncertainty: about 95 % if its contributions are normally distributed and
well known."""
NORMAL_95 = 1.96
"""Deviation of a normally distributed quantity that is exceeded in 5 % of cases, in standard
deviations."""
TURN_V = 0.2
"""Decrease of the voltage, in V, over which the slope after a turning point is measured. It is
twice the change that creep causes in the voltage during a hold of some seconds."""


def coverage(freedom: float) -> float:
    """Return the coverage factor for 95 % by Student's t, for more than 1 degree of freedom.

    It is computed by the series of R. A. Fisher and E. A. Cornish, whose error is 0.3 % for 4
    degrees of freedom, and is at least ``COVERAGE``.
    """
    z = NORMAL_95
    terms = (
        (z**3 + z) / 4.0,
        (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0,
        (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0,
    )
    more = sum(term / freedom**power for power, term in enumerate(terms, start=1))
    return max(COVERAGE, z + more)


def widening(rehearsals: int) -> float:
    """Return the factor by which ``COVERAGE`` is multiplied for an error known from few rehearsals.

    ``rehearsals`` = 0 means that no such correction is needed; the factor is then 1.
    """
    return coverage(rehearsals) / COVERAGE if rehearsals else 1.0


class ShownError(NamedTuple):
    """Standard error of x_1 as observed in rehearsals."""

    error_um: float
    rehearsals: int = 0
    """Number of the rehearsals; 0 if the error needs no correction for a small number of them."""
    until_s: float = 0.0
    """Age of the zero up to which the error is valid, in s; see ``ErrorGrowth``."""


class ErrorGrowth(NamedTuple):
    """E(w) for some values of w; linear in between, 0 at 0 and constant beyond the last value."""

    ways_V: tuple[float, ...]
    """Values of the voltage travel w, in V; rising, the first above 0."""
    errors_um: tuple[float, ...]
    """Standard error for each voltage travel, in µm; it never decreases."""
    until_s: float = 0.0
    """Age of the zero up to which the errors are valid, in s. For later times an error by creep is
    added."""

    def at(self, way_V: float) -> float:
        """Return the standard error of x_1 at a voltage travel since the zero, in µm."""
        from_V = from_um = 0.0
        for to_V, to_um in zip(self.ways_V, self.errors_um, strict=True):
            if way_V <= to_V:
                return from_um + (to_um - from_um) * (way_V - from_V) / (to_V - from_V)
            from_V, from_um = to_V, to_um
        return from_um

    def at_least(self, error_um: float) -> "ErrorGrowth":
        """Return the growth with every error raised to a lower bound, in µm."""
        return self._replace(errors_um=tuple(max(error_um, um) for um in self.errors_um))


def checked_growth(
    ways_V: Sequence[float], errors_um: Sequence[float], until_s: float = 0.0
) -> ErrorGrowth:
    """Return the growth from stored numbers.

    Raises
    ------
    ValueError
        If the lengths differ or are 0, the voltage travel is not positive and rising, or the errors
        decrease.
    """
    require_as_many("ways of the voltage", ways_V, "errors", errors_um)
    if not ways_V:
        raise ValueError("0 motions of the voltage, must be at least 1")
    for name, values, least in (("way", (0.0, *ways_V), 1e-9), ("error", (0.0, *errors_um), 0.0)):
        for before, after in pairwise(values):
            if not after - before >= least:
                raise ValueError(
                    f"{name} {after:g} follows {before:g}: must be larger and start above 0"
                )
    return ErrorGrowth(tuple(ways_V), tuple(errors_um), until_s)
