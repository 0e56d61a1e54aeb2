"""Configuration of the controller from the rig file."""

from collections.abc import Mapping
from dataclasses import dataclass

from msgspec.structs import replace

from pincette.config import RigFile, derived
from pincette.config.laws import installed_laws
from pincette.control.arm.plant import ArmParameters, OutputTiming
from pincette.control.force.position_steps import StepLimits
from pincette.control.laws import two_arms
from pincette.control.laws.definition import LawDefinition, LawSettings
from pincette.control.laws.law import build
from pincette.control.laws.parameters import LawSpec
from pincette.control.laws.two_arm_law import LAW as TWO_ARMS
from pincette.control.planning.program import Program
from pincette.control.response.free_response import FreeResponse
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.voltage import VoltageLimits
from pincette_controller.control_laws import ControlLaw, OneArmLaw, TwoArmsLaw
from pincette_controller.learning import check_cycle


@dataclass(frozen=True, slots=True)
class ArmConfig:
    """An identified arm, and its hard limits."""

    parameters: ArmParameters
    response: FreeResponse
    """Free response of the unpoled arm at 0 V, used by laws of the identified set."""
    monitors: MonitorLimits
    voltage: VoltageLimits


@dataclass(frozen=True, slots=True)
class ControllerConfig:
    """The arms of a rig, and the laws that its programs may name."""

    period_s: float
    arms: tuple[ArmConfig, ...]
    law: LawSettings
    """Law of a program that specifies none."""
    installed: Mapping[str, LawDefinition]
    """Laws by name."""
    force_filter_s: float
    output: OutputTiming
    """Delay and lag between the commanded voltage and the arm."""
    steps: StepLimits
    """Limits by which a step of the position is judged."""
    part_um_per_mN: float
    """Compliance c of a part between two arms, in µm/mN."""

    def laws(self, program: Program) -> tuple[ControlLaw, ...]:
        """Return the laws of a program, in its order; raises ValueError if one is impossible."""
        if len(self.arms) == 2:
            return self._two_arm_laws(program)
        chosen = [self._settings(spec) for spec in program.laws] or [self.law]
        identified = self.arms[0].response
        hysteresis = identified.model if isinstance(identified, IdentifiedResponse) else None
        return tuple(
            OneArmLaw(
                build(
                    settings,
                    self.arms[0].parameters,
                    self.period_s,
                    self.force_filter_s,
                    hysteresis,
                    self.output,
                )
            )
            for settings in chosen
        )

    def _two_arm_laws(self, program: Program) -> tuple[ControlLaw, ...]:
        first, second = (arm.parameters for arm in self.arms)
        arms, period_s = (first, second), self.period_s
        um_per_V = first.d / first.k, second.d / second.k
        return tuple(
            TwoArmsLaw(
                two_arms.build(
                    arms,
                    TWO_ARMS.gains(spec, arms, period_s),
                    period_s,
                    self.part_um_per_mN,
                    self.output,
                ),
                um_per_V,
                period_s,
            )
            for spec in program.laws or (LawSpec(TWO_ARMS.name),)
        )

    def _settings(self, spec: LawSpec) -> LawSettings:
        if spec.scheme not in self.installed:
            there = ", ".join(sorted(self.installed)) or "none"
            raise ValueError(f"no control law {spec.scheme!r} is installed; there are {there}")
        return self.installed[spec.scheme].resolve(spec)


def check_program(config: ControllerConfig, program: Program) -> None:
    """Raise ValueError for a program that cannot be played.

    A model arrives with the arming, so a law that needs a model cannot be created earlier.
    """
    if not program.segments:
        raise ValueError("the program has no segments")
    alone = len(config.arms) == 1
    if alone and any(segment.arms == 2 for segment in program.segments):
        raise ValueError("the program is for two arms, and this rig has one")
    made = program.laws
    if alone and not isinstance(config.arms[0].response, IdentifiedResponse):
        made = tuple(spec for spec in made if spec.set != "identified")
    try:
        if made or not program.laws:
            config.laws(replace(program, laws=made))
    except ValueError as error:
        raise ValueError(f"a law of the program: {error}") from error
    check_cycle(program, config.period_s)
    count = max(1, len(program.laws))
    for segment in program.segments:
        if not alone and segment.arms == 1:
            raise ValueError(f"{segment.phase} is for one arm, and this rig has two")
        if not 0 <= segment.law < count:
            raise ValueError(f"{segment.phase} names law {segment.law}, there are {count}")


def configure(rig: RigFile) -> ControllerConfig:
    """Read the controller's settings from a rig file."""
    return ControllerConfig(
        period_s=rig.rig.period_s,
        arms=tuple(
            ArmConfig(
                arm.model.arm(),
                derived.free_response(arm.model),
                arm.monitors,
                arm.voltage_limits,
            )
            for arm in rig.arms
        ),
        law=rig.law_settings,
        installed=installed_laws(),
        force_filter_s=rig.model.force_filter_s,
        output=rig.output_timing,
        steps=derived.step_limits(rig),
        part_um_per_mN=1.0 / rig.part.stiffness_mN_per_um,
    )
