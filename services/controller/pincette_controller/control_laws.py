"""Adaptors of the control laws for the controller: one interface for one arm and for two.

The equations are in ``pincette.control.laws``. An adaptor derives the inputs of its equations from
the sample and the references, and converts their result to the voltage of each arm.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from msgspec.structs import replace

from pincette.control.laws import law as one_arm
from pincette.control.laws import two_arms
from pincette.control.laws.law import Law, LawState
from pincette.control.laws.planned_motion import RESTING, PlannedMotion
from pincette.control.laws.sliding import LawOutput
from pincette.control.laws.two_arms import Pair, TwoArmParameters, TwoArmReferences, TwoArmState
from pincette.control.planning.contact_line import LoadLine
from pincette.control.planning.segments import Reference
from pincette.control.record import FrozenRecord
from pincette.control.response.free_response import FreeResponse
from pincette.control.response.hysteresis import HysteresisState, displacement_um
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.response.inverse import voltage_for


class ArmView(FrozenRecord, frozen=True):
    """Quantities of one arm at the newest sample."""

    x_um: float
    force_mN: float
    applied_V: float
    limited: int
    """1 if the voltage cannot rise, -1 if it cannot fall, else 0."""
    response: FreeResponse
    """Free response, updated up to this sample."""
    memory: HysteresisState | None
    """Memory of an identified free response; None if no response is identified."""


class Setpoint(FrozenRecord, frozen=True):
    """Goal of a law at the coming sample."""

    ref: Reference
    """References of the law; their speeds are those of the coming motion, 0 at rest."""
    pressed: bool
    """True if the force is an input of the law."""
    open_loop: bool
    """True if the voltage is specified without a law."""
    seeks: bool
    """True if free arms search for the part."""
    line: LoadLine | None
    """Contact line of one pressed arm; None if it is not known or the arm is free."""
    correction_um: float
    """Learned correction that is added to x_r of one arm, in µm."""


class Wanted(FrozenRecord, frozen=True):
    """Voltages that a law requests, and its output at the newest sample."""

    voltages_V: tuple[float, ...]
    """Voltage of each arm, before any limit."""
    x_d_um: float
    """Desired position x_d of the law of one arm at the newest sample, in µm."""
    output: LawOutput
    """Output of the law, for telemetry."""


class Handover(FrozenRecord, frozen=True):
    """References from which a law continues when a segment begins or the law changes."""

    ref: Reference
    """References of the newest sample; if the references restart, those of the coming sample."""
    pressed: bool
    restarted: bool
    """True if the references restart in this tick, so that the law must be rebased."""
    before: "ControlLaw"
    """Law that moved the arms up to the newest sample."""


UNSEEN = LawOutput(*(0.0,) * len(LawOutput.__struct_fields__))
"""Output of a law that has no sliding function and does not observe the arm."""


class ControlLaw(Protocol):
    """A control law with its parameters, for the arms of one rig."""

    arms: ClassVar[int]
    """Number of arms that the law drives."""

    def start(self, arms: tuple[ArmView, ...]) -> Any:
        """Return the state of the law for arms at rest."""
        ...

    def rebase(self, state: Any, arms: tuple[ArmView, ...], handover: Handover) -> Any:
        """Return the state from which the next step changes the voltages without a jump."""
        ...

    def step(self, state: Any, arms: tuple[ArmView, ...], setpoint: Setpoint) -> tuple[Any, Wanted]:
        """Return the next state and the voltages of the coming sample."""
        ...


@dataclass(frozen=True, slots=True)
class OneArmLaw:
    """A law of one arm, which regulates the position and has the force as an input."""

    law: Law
    arms: ClassVar[int] = 1

    def start(self, arms: tuple[ArmView, ...]) -> LawState:
        """Return the state of the law for an arm at rest."""
        (arm,) = arms
        return one_arm.start(
            self.law,
            x_um=arm.x_um,
            x_r_um=arm.x_um,
            force_mN=0.0,
            applied_V=arm.applied_V,
            memory=arm.memory,
        )

    def rebase(self, state: LawState, arms: tuple[ArmView, ...], handover: Handover) -> LawState:
        """Return the state from which the next step changes the voltage without a jump."""
        (arm,), ref, pressed, before = arms, handover.ref, handover.pressed, handover.before
        other = before.law if isinstance(before, OneArmLaw) else self.law
        return one_arm.rebase(
            self.law,
            state,
            x_um=arm.x_um,
            x_r_um=ref.x_um,
            force_mN=arm.force_mN if pressed else 0.0,
            force_r_mN=ref.force_mN if pressed else 0.0,
            seen_V=one_arm.equivalent_voltage_V(self.law, other, arm.applied_V, arm.memory),
        )

    def step(
        self, state: LawState, arms: tuple[ArmView, ...], setpoint: Setpoint
    ) -> tuple[LawState, Wanted]:
        """Return the next state and the voltage of the coming sample.

        The law is stepped in open loop too, so that telemetry shows how the arm differs from its
        model.
        """
        (arm,), ref = arms, setpoint.ref
        plan = RESTING
        if self.law.definition.previews:
            K_e, x_e_um = 0.0, 0.0
            if setpoint.line is not None:
                x_e_um, K_e = setpoint.line
            plan = PlannedMotion(ref.speed_um_per_s, ref.acceleration_um_per_s2, K_e, x_e_um)
        after, output = one_arm.step(
            self.law,
            state,
            x_um=arm.x_um,
            force_mN=arm.force_mN if setpoint.pressed else 0.0,
            applied_V=arm.applied_V,
            x_r_um=ref.x_um + setpoint.correction_um,
            force_r_mN=ref.force_mN if setpoint.pressed else 0.0,
            limited=arm.limited,
            memory=arm.memory,
            plan=plan,
        )
        return after, Wanted((output.voltage_V,), state.x_d_um, output)


@dataclass(frozen=True, slots=True)
class TwoArmsLaw:
    """A law of two arms, which regulates position and opening, or position and force of a held
    part."""

    parameters: TwoArmParameters
    um_per_V: Pair
    """Gain d_p of each arm, in µm/V."""
    period_s: float
    arms: ClassVar[int] = 2

    def start(self, arms: tuple[ArmView, ...]) -> TwoArmState:
        """Return the initial state; the next step starts with the present errors."""
        _ = arms
        return two_arms.start()

    def rebase(
        self, state: TwoArmState, arms: tuple[ArmView, ...], handover: Handover
    ) -> TwoArmState:
        """Return a new state if the references restart.

        The step handles force and opening.
        """
        return self.start(arms) if handover.restarted else state

    def step(
        self, state: TwoArmState, arms: tuple[ArmView, ...], setpoint: Setpoint
    ) -> tuple[TwoArmState | None, Wanted]:
        """Return the next state, None in open loop, and both voltages of the coming sample."""
        first, second = arms
        if setpoint.open_loop:
            return None, Wanted((first.applied_V, second.applied_V), 0.0, UNSEEN)
        ref = setpoint.ref
        after, output = two_arms.step(
            self.parameters,
            state,
            tips_um=(first.x_um, second.x_um),
            free_um=(self._free_um(0, first), self._free_um(1, second)),
            forces_mN=(first.force_mN, second.force_mN),
            references=TwoArmReferences(
                place_um=ref.x_um,
                force_mN=ref.force_mN,
                opening_um=ref.opening_um,
                pressed=setpoint.pressed,
                place_speed_um_per_s=ref.speed_um_per_s,
                place_acceleration_um_per_s2=ref.acceleration_um_per_s2,
                force_rate_mN_per_s=ref.force_rate_mN_per_s,
                opening_speed_um_per_s=ref.opening_speed_um_per_s,
                seeks=setpoint.seeks,
            ),
        )
        one_um, two_um = output.free_um
        voltages_V = self._voltage_V(0, first, one_um), self._voltage_V(1, second, two_um)
        seen = replace(UNSEEN, residual_um=output.place_missed_um)
        return after, Wanted(voltages_V, 0.0, seen)

    def _free_um(self, arm: int, view: ArmView) -> float:
        """Return H at the newest sample, in µm; without an identified response the line d_p·u."""
        response = view.response
        if isinstance(response, IdentifiedResponse):
            return displacement_um(response.model, response.memory)
        return self.um_per_V[arm] * response.voltage_V

    def _voltage_V(self, arm: int, view: ArmView, wanted_um: float) -> float:
        """Return the voltage u = H⁻¹[X], one period ahead, in V."""
        response, d_p = view.response, self.um_per_V[arm]
        if isinstance(response, IdentifiedResponse):
            return voltage_for(
                response.model, response.memory, wanted_um, um_per_V=d_p, period_s=self.period_s
            )
        return wanted_um / d_p
