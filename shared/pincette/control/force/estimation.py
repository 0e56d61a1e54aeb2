"""Contact force (53), quasi-static and with samples of matched ages, and its uncertainty.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013. F > 0 is compressive: the arm grips the
object. (53) as printed has the opposite sign.
"""

from collections.abc import Sequence
from math import exp, hypot, log10, sqrt
from statistics import fmean

from pincette.control.response.error_growth import COVERAGE, coverage


def force(x_um: float, free_um: float, compliance_um_per_mN: float) -> float:
    """Return the contact force in mN from x_k and the free response x_1 to the voltage of k-1.

        F̂ = -(x - x_1)/s_p                                                               (53)

    G⁻¹ ≈ 1 holds if the sampling period is much longer than the period of the resonance. x_k
    responds to the voltage applied at k-1, so x_1 is computed from this voltage. The printed term
    d_p/s_p·[u(t) - u(t - T)] is then left out. It belongs to an x_1 of another age and would be
    read as a force while a free arm moves.
    """
    return (free_um - x_um) / compliance_um_per_mN


def smoothing(period_s: float, time_constant_s: float) -> float:
    """Return 1 - e^(-T/τ), the weight of each new sample in a first-order low-pass.

    It is 1 for τ = 0.

    The low-pass is needed because F̂ contains the sensor's noise amplified by 1/s_p. The control
    law turns it into small swings of the voltage, which erase the memory of the hysteresis.
    """
    return 1.0 - exp(-period_s / time_constant_s) if time_constant_s > 0.0 else 1.0


def uncertainty(
    *,
    noise_um: float,
    free_error_um: float,
    compliance_um_per_mN: float,
    creep_mN_per_decade: float,
    zero_age_s: float,
    forgotten_mN: float,
    few_um: float = 0.0,
    rehearsals: int = 0,
) -> float:
    """Return the expanded uncertainty of the force in mN: root sum of squares, times ``COVERAGE``.

    Its contributions are standard uncertainties: the r.m.s. noise of the sensor and the error of
    the free response since the zero, both divided by s_p; creep that x_1 does not contain, which
    grows with log10(1 + age/1 s), where the age is that of the zero; and the memory that the
    actuator has lost and x_1 has not.

    If a contribution is known from few rehearsals, all contributions except the noise are
    multiplied by Student's t for the effective degrees of freedom (B. L. Welch and F. E.
    Satterthwaite, JCGM 100:2008, G.4):

        n·(u/u_few)⁴

    Parameters
    ----------
    few_um
        Contribution to ``free_error_um`` that was determined from rehearsals.
    rehearsals
        Number n of these rehearsals; 0: the result is not corrected for their number.
    """
    s_p = compliance_um_per_mN
    creep_mN = creep_mN_per_decade * log10(1.0 + max(0.0, zero_age_s))
    steady_mN, factor = hypot(free_error_um / s_p, creep_mN, forgotten_mN), COVERAGE
    if rehearsals and few_um > 0.0:
        factor = coverage(rehearsals * max(1.0, s_p * steady_mN / few_um) ** 4)
    return hypot(factor * steady_mN, COVERAGE * noise_um / s_p)


def late_creep_um(
    *, percent_per_decade: float, stroke_um: float, age_s: float, known_to_s: float
) -> float:
    """Return the standard error from creep slower than any creep that x_1 contains, in µm.

        p/100·|stroke|·log10(age/known_to)/COVERAGE

    for ages beyond ``known_to_s``, 0 before. The creep times are fitted to a motion of about a
    minute, but a hold may last for hours. The remaining creep is at most ``percent_per_decade`` of
    the whole stroke per decade.
    """
    if age_s <= known_to_s:
        return 0.0
    return percent_per_decade / 100.0 * abs(stroke_um) * log10(age_s / known_to_s) / COVERAGE


def uncertainty_of_mean(stated_mN: Sequence[float], *, noise_mN: float, reading_mN: float) -> float:
    """Return the expanded uncertainty in mN of the mean force over n samples.

        U = ⟨√(U_k² - (2·σ_F)² + (2·σ)²/n)⟩

    The errors from the free response, creep and lost memory are common to all samples. Only the
    noise is averaged.

    Parameters
    ----------
    stated_mN
        U_k of the n samples, as ``uncertainty`` returns it; n is at least 1.
    noise_mN
        Standard deviation σ_F of the noise in U_k.
    reading_mN
        Standard deviation σ of a single reading, divided by s_p. A low-pass makes σ_F smaller, but
        not the standard deviation of the mean.
    """
    noise_mN2 = (COVERAGE * noise_mN) ** 2
    mean_mN2 = (COVERAGE * reading_mN) ** 2 / len(stated_mN)
    return fmean(sqrt(max(U_mN * U_mN - noise_mN2, 0.0) + mean_mN2) for U_mN in stated_mN)
