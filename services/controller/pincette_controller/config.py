"""What the controller takes from the rig file."""

from dataclasses import dataclass

from pincette.config import RigFile
from pincette.control.arm.plant import ArmParameters
from pincette.control.laws.law import Law, LawSettings, build
from pincette.control.planning.program import Program
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.voltage import VoltageLimits


@dataclass(frozen=True, slots=True)
class ControllerConfig:
    """The arm as identified, the law where a program names none, the hard limits."""

    period_s: float
    arm: ArmParameters
    law: LawSettings
    force_filter_s: float
    monitors: MonitorLimits
    voltage: VoltageLimits

    def laws(self, program: Program) -> tuple[Law, ...]:
        """Laws of a program, in its order; raises ValueError where one cannot be made."""
        return tuple(
            build(settings, self.arm, self.period_s, self.force_filter_s)
            for settings in program.laws or (self.law,)
        )


def configure(rig: RigFile) -> ControllerConfig:
    """Take the controller's part of a rig file."""
    return ControllerConfig(
        period_s=rig.rig.period_s,
        arm=rig.model.arm(),
        law=rig.law.settings(),
        force_filter_s=rig.model.force_filter_s,
        monitors=rig.monitors,
        voltage=rig.voltage_limits,
    )
