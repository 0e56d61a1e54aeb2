"""Data about one arm for the safety rules: its limits, its voltage and its samples.

All arms of a rig share one latch, one mode and one cause: a fault of one arm trips all, a freeze
keeps all voltages, and a ramp releases all arms in the same time. A part must not be released on
one side only, so no output is written while the voltage of any output is unknown.
"""

from dataclasses import dataclass

from pincette.control.faults import Fault
from pincette.control.record import FrozenRecord
from pincette.control.safety.monitors import UNSEEN, MonitorLimits, Watches
from pincette.control.safety.voltage import VoltageLimits
from pincette.control.voltage_range import VoltageRange


@dataclass(frozen=True, slots=True)
class ArmLimits:
    """Limits of one arm."""

    voltage: VoltageLimits
    monitors: MonitorLimits


class ArmOutput(FrozenRecord, frozen=True):
    """Voltage of one arm, and the state of its rules between events."""

    voltage_V: float = 0.0
    ramp_from_V: float = 0.0
    """Voltage at the start of the ramp, in V."""
    limits_active: int = 0
    """Bits of the voltage limits that acted on the newest command."""
    watches: Watches = UNSEEN
    planned: VoltageRange | None = None
    """Voltage range of the plan for this arming; None for the limits of the rig."""


class ArmFacts(FrozenRecord, frozen=True):
    """Values for one arm in a command, as used by the safety rules."""

    voltage_V: float
    force_mN: float | None = None
    x_d_um: float | None = None


def with_arm(found: Fault, arm: int) -> Fault:
    """Return the fault with the number of its arm, except for the first arm.

    Parameters
    ----------
    arm
        Index of the arm, from 0.
    """
    return found if arm == 0 else found.with_values(arm=arm + 1)
