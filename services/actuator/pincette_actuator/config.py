"""What the actuator takes from the rig file: the limits of the safety module."""

from math import floor

from pincette.config import ConfigError, RigFile
from pincette.control.safety.freshness import AgeLimits
from pincette.control.safety.state import SafetyLimits

GRACE_PERIODS = 50.0
"""How long after arming the first command may come."""
WAKE_PERIODS = 0.25
"""How often the actuator looks at its clock in real time."""
EXCUSED_PERIODS = 10.0
"""How much of the actuator's own standstill is left out of an age, from one command to the next."""


def configure(rig: RigFile) -> SafetyLimits:
    """Take the actuator's part of a rig file; raises ConfigError."""
    limits, safety, period_s = rig.limits, rig.safety, rig.rig.period_s
    if not limits.voltage_min_V <= safety.safe_V <= limits.voltage_max_V:
        raise ConfigError(
            f"[safety] safe_V = {safety.safe_V} V is outside "
            f"{limits.voltage_min_V}..{limits.voltage_max_V} V"
        )
    return SafetyLimits(
        period_s=period_s,
        lockstep=rig.lockstep,
        age=AgeLimits(
            limit_s=safety.command_age_periods * period_s,
            limit_ticks=floor(safety.command_age_periods),
            grace_s=GRACE_PERIODS * period_s,
            wake_s=WAKE_PERIODS * period_s,
            excused_s=EXCUSED_PERIODS * period_s,
        ),
        voltage=rig.voltage_limits,
        monitors=rig.monitors,
        ramp_s=safety.ramp_s,
        freeze_s=safety.freeze_s,
        safe_V=safety.safe_V,
    )
