"""Required stability of a loop at its period, and the range over which it is required.

If the sampling period is short compared with that of the mode, the ringing continues from sample to
sample. A law must then not excite the mode, whatever the calibration errors. A radius near 1 says
little about the distance from instability, which is measured by the peak sensitivity M_s.
"""

from dataclasses import replace

from pincette.control.force.observers import least_period_s
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.worst_case import Intervals

LIMIT_RADIUS, LIMIT_PERIOD_S = 0.97, 0.02
"""Limit of the spectral radius, and the period in s for which it is given. At other periods the
limit has the same time constant, 0.66 s: a disturbance decays to 2 % in 2.6 s, the duration of a
typical load. A slower loop would not settle within the plan. See ``limit_radius_at``."""
LIMIT_PEAK = 2.0
"""Largest M_s at periods that are short compared with that of the mode, where a radius near 1 says
little about the distance from instability."""


def limit_radius_at(period_s: float) -> float:
    """Return 0.97^(T/20 ms), the radius at period T of a decay as fast as 0.97 at 20 ms."""
    return LIMIT_RADIUS ** (period_s / LIMIT_PERIOD_S)


def short(loop: Loop) -> bool:
    """Return whether the period is so short that the mode rings on between samples."""
    return loop.period_s < least_period_s((loop.arm.k / loop.arm.m) ** 0.5)


def widened(loop: Loop, intervals: Intervals) -> Intervals:
    """Return the intervals that a loop must tolerate at its period.

    At a short period the law must not excite the mode, whatever the errors of the calibration: ω_n
    ± 20 %, ζ from 0.77 to 1.35 times, K_e from half to twice the one given to the law, the delay
    from 0.3 to 1 period, the slope of H from 0.7 to 1.2 times, and contacts that begin or end
    before the law is informed. At longer periods the intervals are unchanged.
    """
    if not short(loop):
        return intervals
    stiffness, assumed = intervals.K_e_mN_per_um, intervals.assumed_mN_per_um
    if stiffness is not None:
        assumed = assumed or 0.5 * (stiffness[0] + stiffness[1])
        stiffness = min(0.5 * assumed, stiffness[0]), max(2.0 * assumed, stiffness[1])
    frequency, gain = intervals.frequency_factor, intervals.gain_factor
    return replace(
        intervals,
        K_e_mN_per_um=stiffness,
        assumed_mN_per_um=assumed,
        frequency_factor=(min(0.8, frequency[0]), max(1.2, frequency[1])),
        gain_factor=(min(0.7, gain[0]), max(1.2, gain[1])),
        delay_periods=(0.3, 1.0),
        damping_factor=(0.77, 1.35),
        uninformed=True,
    )
