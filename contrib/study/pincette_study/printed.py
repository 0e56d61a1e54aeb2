"""Values printed in the paper: Q. Xu, IEEE T-ASE 10(3), 2013, by section, figure and table."""

from typing import NamedTuple

PERIOD_S = 0.02
"""Sampling period in s, section VI.C.2."""
FREQUENCY_HZ = 0.5
"""Frequency of the sinusoids of Figs. 7, 9 and 10, in Hz."""
X_PP_UM = 8.45
FORCE_PP_MN = 20.0
"""Planned peak-to-peak force in mN, section VI.C.1; the paper uses the opposite sign."""
PLANNED_STIFFNESS = FORCE_PP_MN / X_PP_UM
"""Stiffness of the planned pair, in mN/µm."""
VOLTAGE_LEVELS_V = (0.3, 1.0, 1.5, 2.0)
"""Peak-to-peak voltages in V, Fig. 8."""

NATURAL_FREQUENCY_SQUARED = 5.9430e6
DAMPING_PER_S = 126.8
"""Coefficients of (54): ω_n² in 1/s² and 2ζω_n in 1/s."""
PIEZO_UM_PER_V = 19.0
"""Gain in µm/V, section VI.B."""
WEIGHT_MN, SAG_UM = 25.0, 11.5
"""Known weight in mN and the displacement that it caused in µm, (55)."""
STIFFNESS_SLOPE_MN_PER_UM = 2.47
"""Slope of the line in Fig. 8; with the offset through the planned pair, F_pp = 2.47·x_pp -
0.87."""
PLANNING_ERROR_UM, PLANNING_ERROR_MN = 1.0, -4.0
"""Largest planning errors, Fig. 7(d), at the same time; the force has the paper's negative sign."""
ESTIMATOR_FREE_RMSE_MN = 0.26
"""R.m.s. error of the estimator without contact in mN, section VI.B, Fig. 6(d)."""


class Tracking(NamedTuple):
    """Tracking errors of a trajectory; percentages are relative to the peak-to-peak magnitudes."""

    position_um: float
    position_percent: float
    force_mN: float
    force_percent: float


TABLE_I = {
    5.0: Tracking(1.3710, 16.22, 0.5620, 2.81),
    2.0: Tracking(0.7519, 8.90, 1.1557, 5.78),
    1.0: Tracking(0.5119, 6.06, 1.5532, 7.77),
    0.5: Tracking(0.4069, 4.82, 1.8454, 9.23),
}
"""Errors of PBSMIC for several K_P; K_I = 1, K_S = 0.003, δ = 100."""

PBSMIC_LARGEST_UM, PBSMIC_LARGEST_MN = 0.89, 3.44
"""Largest errors in Fig. 9. The caption gives K_P = 1, the text K_P = 5; 0.89 µm is below the RMSE
of K_P = 5."""
DSMIFC_LARGEST_UM, DSMIFC_LARGEST_MN = 1.39, 3.45
"""Largest errors in Fig. 10, K_f = 5000."""
BALANCED_K_F, BALANCED_PERCENT = 4000.0, 8.1
"""Value of K_f at which both relative RMSEs of DSMIFC are about equal, and their value, Fig. 11."""
K_F_SWEEP = (0.0, 1000.0, 2000.0, 3000.0, 4000.0, 5000.0, 6000.0)
"""Values of K_f in Fig. 11. Up to 5000 the position error increases and the force error decreases;
at 6000 the loop oscillates."""
