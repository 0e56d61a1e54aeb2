"""The second arm of a rig that has two: its limits, its voltage, and what was seen of it.

Both arms have one latch, one mode and one cause: what trips either trips both, a freeze keeps both
voltages, and a ramp lets both go in the same time. So that no part is let go on one side alone,
neither is written while what either puts out is not known.
"""

from dataclasses import dataclass

from msgspec.structs import replace

from pincette.control.record import FrozenRecord
from pincette.control.safety.monitors import UNSEEN, Finding, MonitorLimits, Watches, finding
from pincette.control.safety.voltage import VoltageLimits, ramp


@dataclass(frozen=True, slots=True)
class SecondLimits:
    """What of the limits is the second arm's own."""

    voltage: VoltageLimits
    monitors: MonitorLimits


class SecondArm(FrozenRecord, frozen=True):
    """What the rules remember of the second arm from one event to the next."""

    voltage_V: float
    ramp_from_V: float = 0.0
    limits_active: int = 0
    watches: Watches = UNSEEN

    def at(self, voltage_V: float) -> "SecondArm":
        """This arm at another voltage."""
        return replace(self, voltage_V=voltage_V)

    def armed(self) -> "SecondArm":
        """This arm as a new arming finds it, at the voltage there is."""
        return SecondArm(self.voltage_V)

    def ramped(self) -> "SecondArm":
        """This arm as its ramp begins."""
        return replace(self, ramp_from_V=self.voltage_V)

    def on_ramp(self, safe_V: float, share: float) -> "SecondArm":
        """This arm after a share of the ramp's time."""
        return replace(self, voltage_V=ramp(self.ramp_from_V, safe_V, share))


def second_finding(limits: MonitorLimits, watches: Watches) -> Finding | None:
    """The gravest limit of the second arm that acts; its fault says whose it is."""
    found = finding(limits, watches)
    return found and found._replace(fault=found.fault.with_values(arm=2))


class SecondFacts(FrozenRecord, frozen=True):
    """What the safety rules know of the second arm's part of a command."""

    voltage_V: float
    force_mN: float | None = None
    x_d_um: float | None = None
