"""Check whether an arm moves as freely as without a part, from its position and voltage.

With the free position x_1, an arm at rest that presses or pulls a part of stiffness K has

    x = (x_1 + s_p·K·x_e)/(1 + s_p·K),    so that    Δx = r·Δx_1,    r = 1/(1 + s_p·K)

and a free arm has r = 1. The ratio r does not depend on the zero of the force. It is fitted over a
small motion. If the arm moves forth and back, a drift in time is fitted too, so that creep does not
affect r:

    x - x_1 = a + (r - 1)·x_1 + b·t

Its uncertainty U comes from the residuals, but at least from the sensor's noise, and from the error
of x_1 over the motion. The arm may be free if 1 is within r ± U, and held if r - U is at most the r
of the softest part. If exactly one of the two is possible, it is the verdict. If the part comes off
during the motion, the samples do not lie on a line, and U exceeds the difference between both
ratios.
"""

from math import sqrt
from typing import Literal, NamedTuple

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.force.estimation import COVERAGE
from pincette.control.quantities import Micrometre, MicrometrePerMillinewton, Number
from pincette.control.record import FrozenRecord

Verdict = Literal["released", "sticks", "unknown"]
LEAST_SHARE = 0.02
"""Smallest ratio r that is used; it bounds the stiffness that is reported."""
LEAST_SAMPLES = 8


class FreeArm(FrozenRecord, frozen=True):
    """Properties of an arm that are needed to decide whether it is free.

    Raises
    ------
    ValueError
        If compliance or ``held_share`` is not positive, or an error is negative.
    """

    compliance_um_per_mN: MicrometrePerMillinewton
    held_share: Number
    """Ratio r of an arm that holds the softest part."""
    share_error: Number
    """Standard error of r that the error of x_1 over the motion of the check causes."""
    noise_um: Micrometre
    """R.m.s. noise of one reading of the sensor, in µm."""

    def __post_init__(self) -> None:
        require_positive("compliance", self.compliance_um_per_mN, "µm/mN")
        require_positive("share of a held arm", self.held_share, "")
        require_not_negative("error of the share", self.share_error, "")
        require_not_negative("noise", self.noise_um, "µm")


class Freedom(NamedTuple):
    """Ratio r of an arm's motion to its free motion, with the expanded uncertainty."""

    share: float
    uncertainty: float

    def verdict(self, arm: FreeArm) -> Verdict:
        """Return whether the ratio shows a free arm, a held part, or neither."""
        if self.uncertainty > 1.0 - arm.held_share:
            return "unknown"
        free = abs(self.share - 1.0) <= self.uncertainty
        held = self.share - self.uncertainty <= arm.held_share
        if free == held:
            return "unknown"
        return "released" if free else "sticks"

    def stiffness(self, arm: FreeArm) -> tuple[float, float]:
        """Return the stiffness that holds the arm and its expanded uncertainty, in mN/µm."""
        share, s_p = max(self.share, LEAST_SHARE), arm.compliance_um_per_mN
        return (1.0 / share - 1.0) / s_p, self.uncertainty / (share * share * s_p)


class FreedomFit(FrozenRecord, frozen=True):
    """Sums over the samples of a motion, from which r is fitted, relative to the first sample."""

    count: int = 0
    begin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Time, x_1 and x - x_1 of the first sample."""
    sums: tuple[float, float, float] = (0.0, 0.0, 0.0)
    products: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Sums of t², t·f, t·e, f², f·e and e², with f = x_1 and e = x - x_1."""

    def add(self, arm: FreeArm, t_s: float, x_um: float, force_mN: float) -> "FreedomFit":
        """Return the fit with one more sample."""
        lag_um = -arm.compliance_um_per_mN * force_mN
        row = t_s, x_um - lag_um, lag_um
        begin = self.begin if self.count else row
        t, f, e = row[0] - begin[0], row[1] - begin[1], row[2] - begin[2]
        (st, sf, se), (tt, tf, te, ff, fe, ee) = self.sums, self.products
        products = tt + t * t, tf + t * f, te + t * e, ff + f * f, fe + f * e, ee + e * e
        return FreedomFit(self.count + 1, begin, (st + t, sf + f, se + e), products)

    def freedom(self, arm: FreeArm, *, drifts: bool) -> Freedom | None:
        """Return r and U, or None for too few samples or a motion that does not determine r.

        Parameters
        ----------
        drifts
            True to fit a drift in time, for a motion forth and back.
        """
        n = self.count
        if n < LEAST_SAMPLES:
            return None
        (st, sf, se), (tt, tf, te, ff, fe, ee) = self.sums, self.products
        tt, tf, te = tt - st * st / n, tf - st * sf / n, te - st * se / n
        ff, fe, ee = ff - sf * sf / n, fe - sf * se / n, ee - se * se / n
        if drifts:
            if tt <= 0.0:
                return None
            ff, fe, ee = ff - tf * tf / tt, fe - tf * te / tt, ee - te * te / tt
        if ff <= 0.0:
            return None
        slope = fe / ff
        left_um2 = max(0.0, ee - slope * fe) / (n - 3 if drifts else n - 2)
        scatter_um2 = max(left_um2, arm.noise_um * arm.noise_um)
        return Freedom(1.0 + slope, COVERAGE * sqrt(scatter_um2 / ff + arm.share_error**2))
