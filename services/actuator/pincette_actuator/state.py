"""State of the actuator around the safety rules, and its messages and device commands."""

from msgspec.structs import replace

from pincette.control.arm.shaping import ShapedStep
from pincette.control.planning.sweep import Sweep
from pincette.control.safety.admission import CommandFacts
from pincette.control.safety.arm import ArmFacts
from pincette.control.safety.causes import Mode
from pincette.control.safety.state import SafetyLimits, SafetyState
from pincette.core.messages import Applied, Command
from pincette.core.messages.arms import ArmApplied
from pincette.core.service import CheckWave, DeviceCommand, SetVoltage, Wave, WriteParts


class State(SafetyState, frozen=True):
    """State of the safety module, extended by that of the service."""

    pending: Command | None = None
    """Command that arrived before its sample; None if no command waits."""
    answered_seq: int = -1
    sweep: Sweep | None = None
    """Sweep that the instrument plays around the voltage of the first arm."""

    def settled(self) -> "State":
        """Return the state, without its sweep if the actuator is not armed.

        A waiting command is kept. It is judged when its sample arrives, since in lockstep the
        judgement ends the tick.
        """
        if self.mode == Mode.ARMED or self.sweep is None:
            return self
        return replace(self, sweep=None)


def facts_of(command: Command) -> CommandFacts:
    """Return the values of a command that the safety rules check."""
    arms: list[ArmFacts] = []
    for arm in command.arms:
        arms.append(ArmFacts(arm.voltage_V, arm.force_mN, arm.x_d_um))
    return CommandFacts(
        epoch=command.epoch,
        owner=command.owner,
        seq=command.seq,
        arms=tuple(arms),
        part_held=command.part_held,
        final=command.final,
        valid=command.valid,
        fault=command.fault,
        sweep_V=None if command.sweep is None else command.sweep.amplitude_V,
    )


def applied_of(
    state: State, seq: int, command: Command | None = None, age_s: float = 0.0
) -> Applied:
    """Return the outcome of tick ``seq``; ``command`` was used for it, at age ``age_s``."""
    arms: list[ArmApplied] = []
    for arm in state.arms:
        arms.append(ArmApplied(arm.voltage_V, arm.limits_active))
    return Applied(
        epoch=state.epoch,
        seq=seq,
        arms=tuple(arms),
        state=state.mode,
        cause=state.cause,
        faults=state.faults,
        part_held=state.part_held,
        zero=command is not None and command.zero,
        final=state.mode in (Mode.IDLE, Mode.LATCHED),
        answered=command is not None,
        refused=state.refused,
        command_age_s=age_s,
        unconfirmed=state.unconfirmed and not state.located,
        segment=None if command is None else command.segment,
        segment_tick=0 if command is None else command.segment_tick,
        slewing_s=None if command is None else state.slewing_s,
        step_um=None if command is None else command.step_um,
    )


def voltages_of(state: State) -> tuple[float, ...]:
    """Return the voltage of each arm, in V."""
    return tuple([arm.voltage_V for arm in state.arms])


def step_of(limits: SafetyLimits, step: ShapedStep) -> DeviceCommand:
    """Return the device command to output a step in parts."""
    return WriteParts(step.parts_V(limits.arms[0].voltage.step_V), limits.shaping_s or 0.0)


def order_of(state: State, before: State) -> DeviceCommand:
    """Return the command to the instrument: a voltage ends a sweep, while a playing sweep
    continues."""
    if state.sweep is None:
        return SetVoltage(voltages_of(state))
    if state.sweep == before.sweep:
        return CheckWave()
    # Imported only if an output that plays waves was opened; other programs need no NumPy.
    from pincette.control.planning.swept_voltages import SweptVoltages

    return Wave(SweptVoltages(state.sweep, state.arms[0].voltage_V), state.sweep.rate_hz)
