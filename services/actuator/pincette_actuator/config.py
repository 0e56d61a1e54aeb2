"""What the actuator takes from the rig file."""

from dataclasses import dataclass

from pincette.config import ConfigError, RigFile

GRACE_PERIODS = 50.0
"""How long after arming the first command may come."""
WAKE_PERIODS = 0.25
"""How often the actuator looks at its clock in real time."""
EXCUSED_PERIODS = 10.0
"""How much of the actuator's own standstill is left out of an age, from one command to the next."""


@dataclass(frozen=True, slots=True)
class ActuatorConfig:
    """Limits and times of the actuator; voltages at the amplifier's input."""

    period_s: float
    lockstep: bool
    wake_s: float
    excused_s: float
    age_limit_s: float
    grace_s: float
    ramp_s: float
    freeze_s: float
    safe_V: float
    voltage_min_V: float
    voltage_max_V: float
    slew_V: float
    """Largest change of the voltage from one command to the next."""
    sweep_V: float
    """Largest amplitude of a sweep, to which the slew limit does not apply."""


def configure(rig: RigFile) -> ActuatorConfig:
    """Take the actuator's part of a rig file; raises ConfigError."""
    limits, safety, period_s = rig.limits, rig.safety, rig.rig.period_s
    if not limits.voltage_min_V <= safety.safe_V <= limits.voltage_max_V:
        raise ConfigError(
            f"[safety] safe_V = {safety.safe_V} V is outside "
            f"{limits.voltage_min_V}..{limits.voltage_max_V} V"
        )
    return ActuatorConfig(
        period_s=period_s,
        lockstep=rig.lockstep,
        wake_s=WAKE_PERIODS * period_s,
        excused_s=EXCUSED_PERIODS * period_s,
        age_limit_s=safety.command_age_periods * period_s,
        grace_s=GRACE_PERIODS * period_s,
        ramp_s=safety.ramp_s,
        freeze_s=safety.freeze_s,
        safe_V=safety.safe_V,
        voltage_min_V=limits.voltage_min_V,
        voltage_max_V=limits.voltage_max_V,
        slew_V=limits.slew_V_per_s * period_s,
        sweep_V=limits.sweep_V,
    )
