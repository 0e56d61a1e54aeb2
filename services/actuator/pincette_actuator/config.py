"""Configuration of the actuator from the rig file: the limits of the safety module."""

from math import floor, pi

from pincette.config import ConfigError, RigFile
from pincette.control.safety.arm import ArmLimits
from pincette.control.safety.freshness import AgeLimits
from pincette.control.safety.state import SafetyLimits

GRACE_PERIODS = 50.0
"""Time after the arming within which the first command must arrive, in periods."""
WAKE_PERIODS = 0.2
"""Approximate interval, in periods, at which the actuator checks its clock in real time."""
MOST_PERIODS = 0.25
"""Upper bound of the interval at which the actuator checks its clock, in periods; with a longer
interval a silent controller would be noticed late.
"""
EXCUSED_PERIODS = 10.0
"""Longest total suspension of the actuator program between two commands that is not counted in the
age of a command, in periods.
"""


def configure(rig: RigFile) -> SafetyLimits:
    """Read the actuator's settings from a rig file; raises ConfigError."""
    safety, period_s = rig.safety, rig.rig.period_s
    for arm, where in zip(rig.arms, ("", " of [second.limits]"), strict=False):
        limits = arm.limits
        if not limits.voltage_min_V <= safety.safe_V <= limits.voltage_max_V:
            raise ConfigError(
                f"[safety] safe_V = {safety.safe_V} V is outside "
                f"{limits.voltage_min_V}..{limits.voltage_max_V} V{where}"
            )
    return SafetyLimits(
        period_s=period_s,
        lockstep=rig.lockstep,
        age=AgeLimits(
            limit_s=safety.command_age_periods * period_s,
            limit_ticks=floor(safety.command_age_periods),
            grace_s=GRACE_PERIODS * period_s,
            wake_s=wake_s(period_s, rig.model.natural_frequency_rad_per_s),
            excused_s=EXCUSED_PERIODS * period_s,
        ),
        arms=tuple(ArmLimits(arm.voltage_limits, arm.monitors) for arm in rig.arms),
        ramp_s=safety.ramp_s,
        freeze_s=safety.freeze_s,
        safe_V=safety.safe_V,
        shaping_s=rig.shaping_s,
    )


def wake_s(period_s: float, natural_frequency_rad_per_s: float) -> float:
    """Return the time between two checks of the clock, and so between two steps of a ramp, in s.

    It is an odd multiple of the mode's half period π/ω_n, namely the multiple within T/4 that is
    nearest to 0.2·T: each step of the ramp then cancels the oscillation of the step before. If T/4
    is shorter than one half period, the time is 0.2·T, since the mode follows such steps
    quasi-statically.
    """
    half_swing_s = pi / natural_frequency_rad_per_s
    about, most = WAKE_PERIODS * period_s / half_swing_s, MOST_PERIODS * period_s / half_swing_s
    if most < 1.0:
        return WAKE_PERIODS * period_s
    swings = min(round((about - 1.0) / 2.0), int((most - 1.0) / 2.0))
    return (2 * swings + 1) * half_swing_s
