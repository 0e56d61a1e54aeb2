"""Contact line that the references of a load follow while the line is identified.

A load moves F_r and x_r together along F_r = K_e·(x_r - x_e). The force on a part that is harder
than the line is too high: for twice the planned stiffness, up to twice the force. Therefore a load
begins on the line of the hardest permitted part, and continues with the stiffest line that agrees
with its samples:

    K = min(hardest, K_fit·(1 + 2·e)),    x_e = mean x - mean F/K
    e = max((1 + 1/kappa)·sigma/(s·√n), standard error of K_fit/K_fit),    kappa = s_p·K_fit

for n samples whose position has the standard deviation s, and the r.m.s. noise sigma of one
reading, which affects both x and F. The error e decreases during the load, so that the references
end on the fitted line. Until then the force on a softer part is below F_r, never above it. The
samples before and after an undetected slip do not lie on a straight line, and their stiffness is
not used.

K and x_e approach these values with a time constant of 20 ms, so that no reference jumps.
"""

from math import exp, inf, isfinite, sqrt

from pincette.control.planning.contact_line import ContactFit, ContactLine, LoadLine
from pincette.control.planning.program import Guards

LEAST_STIFFNESS, MOST_STIFFNESS = 0.3, 3.0
"""Bounds of a usable contact stiffness, as multiples of the planned one."""
LINE_S = 0.02
"""Time constant with which the references follow the line, in s."""
STANDARD_ERRORS = 2.0
"""Number of standard errors by which the line of the references is stiffer than the fitted line."""
LEAST_SPREAD_UM = 0.02
"""Standard deviation of the position below which no stiffness is fitted, in µm."""
LEAST_COUNT = 3
"""Smallest number of samples of a load for which a line of the softest or hardest permitted
stiffness is accepted, if there is no fit within the permitted range."""
STRAIGHT_SIGMAS, STRAIGHT_UM = 1.4, 0.05
"""Largest scatter about a contact line that counts as straight: a multiple of the sensor's noise,
plus an error of the free response in µm. Applied to the standard deviation itself, these limits
would refuse 1.8 % of 6000 fits to three samples of a straight line at a noise of 0.05 µm, and 8.3 %
at 0.15 µm; applied to ``ContactFit.scatter_mN`` they refuse 0.3 % at most."""
fit_line, spread_um = ContactLine.fit, ContactLine.spread_um


def stiffness_bounds(planned_mN_per_um: float, guards: Guards) -> tuple[float, float]:
    """Return the smallest and the largest contact stiffness that may be used, in mN/µm.

    They are 0.3 and 3 times the planned one. The guards of a program that measures the stiffness
    contain wider bounds, which are used instead. An infinite upper bound of the guards is not used,
    since a load cannot begin on a line of infinite stiffness.
    """
    least = min(LEAST_STIFFNESS * planned_mN_per_um, guards.stiffness_min_mN_per_um)
    most = MOST_STIFFNESS * planned_mN_per_um
    if isfinite(guards.stiffness_max_mN_per_um):
        most = max(most, guards.stiffness_max_mN_per_um)
    return least, most


def line_share(period_s: float) -> float:
    """Return the fraction of the remaining distance by which the line moves in a period."""
    return 1.0 - exp(-period_s / LINE_S)


def is_straight(fit: ContactFit, noise_um: float, compliance_um_per_mN: float) -> bool:
    """Return whether the scatter of the samples is small enough for a straight line.

    Parameters
    ----------
    noise_um
        R.m.s. noise of one reading, which affects both x and F.
    """
    mN_per_um = fit.K_e_mN_per_um + 1.0 / compliance_um_per_mN
    return fit.scatter_mN <= (STRAIGHT_SIGMAS * noise_um + STRAIGHT_UM) * mN_per_um


def stiffness_error(
    line: ContactLine, fit: ContactFit, noise_um: float, compliance_um_per_mN: float
) -> float:
    """Return the relative standard error of a fitted stiffness.

    It is the larger one of the errors computed from the noise and from the scatter: the scatter of
    a few samples may be too small by chance.
    """
    K_e = fit.K_e_mN_per_um
    readings = spread_um(line) * sqrt(line.count)
    noise = (1.0 + 1.0 / (compliance_um_per_mN * K_e)) * noise_um / readings
    return max(noise, fit.K_e_error_mN_per_um / K_e)


def stiffest_line(
    line: ContactLine, hardest_mN_per_um: float, noise_um: float, compliance_um_per_mN: float
) -> LoadLine:
    """Return the stiffest line through the mean that agrees with the samples of a load.

    Parameters
    ----------
    line
        Sums over at least one sample.
    hardest_mN_per_um
        Stiffness of the hardest permitted part.
    """
    K_e = hardest_mN_per_um
    fit = fit_line(line, LEAST_SPREAD_UM)
    if fit is not None:
        rises = fit.K_e_mN_per_um > 0.0
        if rises and is_straight(fit, noise_um, compliance_um_per_mN):
            error = stiffness_error(line, fit, noise_um, compliance_um_per_mN)
            K_e = min(K_e, fit.K_e_mN_per_um * (1.0 + STANDARD_ERRORS * error))
    return line_through_mean(line, K_e)


def line_through_mean(line: ContactLine, K_e_mN_per_um: float) -> LoadLine:
    """Return the line of a given stiffness through the mean of one sample or more."""
    x_um = line.first_x_um + line.sum_x / line.count
    force_mN = line.first_force_mN + line.sum_F / line.count
    return LoadLine(x_um - force_mN / K_e_mN_per_um, K_e_mN_per_um)


def errors_off(
    line: ContactLine, K_e_mN_per_um: float, noise_um: float, compliance_um_per_mN: float
) -> float:
    """Return by how many standard errors a load differs from that of a part of stiffness K.

        |cov(F, F_r) - K·cov(x, F_r)|·√n/(σ(F_r)·sigma·(K + 1/s_p))

    Noise of the sensor enters F - K·x with the factor K + 1/s_p. Unlike the standard error of a
    fitted K, this stays right where x hardly moves (T. W. Anderson and H. Rubin, Annals of
    Mathematical Statistics 20, 1949).

    Parameters
    ----------
    line
        Sums over one sample or more.
    noise_um
        R.m.s. noise of one reading; with 0 any difference counts as infinite.
    """
    n = line.count
    x, F, z = line.sum_x / n, line.sum_F / n, line.sum_z / n
    cov_Fz, cov_xz = line.sum_Fz / n - F * z, line.sum_xz / n - x * z
    off_mN2 = abs(cov_Fz - K_e_mN_per_um * cov_xz) * sqrt(n)
    spread_mN = sqrt(max(0.0, line.sum_zz / n - z * z))
    one_mN2 = spread_mN * noise_um * (K_e_mN_per_um + 1.0 / compliance_um_per_mN)
    return off_mN2 / one_mN2 if one_mN2 > 0.0 else inf
