"""Admission of commands: authority, numbers, order, sample, age; and the effect of an accepted one.

A command is considered only if it comes from the owner and belongs to the epoch of the arming. The
force and target that it reports for its sample are compared with the hard limits, whether it is
valid or not. After this comparison the command is accepted or refused.
"""

from itertools import chain, repeat
from math import isfinite
from typing import TypeVar

from msgspec.structs import replace

from pincette.control.arm.shaping import ShapedStep
from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.record import FrozenRecord
from pincette.control.safety.arm import ArmFacts, ArmOutput, with_arm
from pincette.control.safety.causes import Mode
from pincette.control.safety.freshness import (
    ARRIVALS_KEPT,
    Arrival,
    arrival_of,
    newest_seq,
    too_old,
    with_sample,
)
from pincette.control.safety.latch import broken_off, released, trip
from pincette.control.safety.monitors import (
    Finding,
    Watches,
    finding,
    watch_command,
    watch_position,
)
from pincette.control.safety.state import SafetyLimits, SafetyState, UnauthorizedCommands
from pincette.control.safety.voltage import (
    VoltageLimits,
    absurd,
    limited,
    slewing_s,
    too_wide,
    within,
)

S = TypeVar("S", bound=SafetyState)


class CommandFacts(FrozenRecord, frozen=True):
    """Properties of a command that the safety rules use."""

    epoch: int
    owner: int
    seq: int
    """Number of the sample that the command is based on."""
    arms: tuple[ArmFacts, ...]
    part_held: bool
    final: bool
    valid: bool
    fault: Fault | None = None
    """Reason why the command is not valid; None if it is valid or states no reason."""
    sweep_V: float | None = None
    """Amplitude of a sweep about the voltage of the first arm, in V; None without a sweep."""


def sampled(
    limits: SafetyLimits, state: S, seq: int, x_um: tuple[float | None, ...], now: float
) -> S:
    """Add a sample of this epoch and compare the position of each arm with its limits.

    A sample with an older or equal number changes nothing.

    Parameters
    ----------
    x_um
        Position of each arm; None if it was not measured.
    """
    arrivals = with_sample(state.arrivals, seq, now, x_um)
    if arrivals is state.arrivals:
        return state
    state = replace(state, arrivals=arrivals)
    if state.mode != Mode.ARMED:
        return state
    for index, (own, measured_um) in enumerate(zip(limits.arms, x_um, strict=False)):
        if measured_um is None:
            continue
        before = state.arms[index].watches
        watches = watch_position(own.monitors, before, measured_um)
        if watches is before:
            continue
        state = _watched(state, index, watches)
        if found := finding(own.monitors, watches):
            state = _tripped(limits, state, index, found, now)
    return state


def _watched(state: S, index: int, watches: Watches) -> S:
    """Return the state with new observations of one arm."""
    arms = list(state.arms)
    arms[index] = replace(arms[index], watches=watches)
    return replace(state, arms=tuple(arms))


def _tripped(limits: SafetyLimits, state: S, index: int, found: Finding, now: float) -> S:
    return trip(limits, state, found.cause, now, faults=(with_arm(found.fault, index),))


def authority_fault(state: SafetyState, command: CommandFacts) -> Fault | None:
    """Return the reason why a command is ignored; None if it is considered.

    A command is ignored if it has no authority, or if its sample number is so far ahead that it
    cannot simply have arrived before its sample.
    """
    if command.epoch != state.epoch:
        return fault(FaultCode.OTHER_EPOCH, epoch=command.epoch, armed_epoch=state.epoch)
    if command.owner != state.owner:
        return fault(FaultCode.OTHER_OWNER, owner=command.owner, armed_owner=state.owner)
    newest = newest_seq(state.arrivals)
    if command.seq > newest + ARRIVALS_KEPT:
        return fault(FaultCode.COMMAND_AHEAD, seq=command.seq, newest_seq=newest)
    return None


def reject(state: S, command: CommandFacts, why: Fault) -> S:
    """Count an ignored command; several of them raise an alarm about another sender.

    Invalid commands do not count, since a controller sends one for every sample before it is armed.
    """
    if not command.valid:
        return state
    unauthorized = UnauthorizedCommands(state.unauthorized.count + 1, why)
    return replace(state, refused=state.refused + 1, refusal=why, unauthorized=unauthorized)


def is_future(state: SafetyState, command: CommandFacts) -> bool:
    """Return whether a command has arrived before its sample, and must wait for it."""
    return command.seq > newest_seq(state.arrivals)


def judged(limits: SafetyLimits, state: S, command: CommandFacts, now: float) -> S:
    """Accept or refuse a command with authority, or trip if the values that it reports exceed
    limits.

    An invalid command is never accepted; its reason is stored for a trip that may follow.
    """
    if why := unusable(limits, command):
        why = why.with_values(seq=command.seq)
        return replace(state, refused=state.refused + 1, refusal=why)
    sample = arrival_of(state.arrivals, command.seq)
    if sample is not None:
        state = _monitored(limits, state, command, sample, now)
    if not command.valid:
        return replace(state, blind=command.fault)
    # If a sample was lost, use the age of the sample before it, which is an upper bound of its age.
    oldest = sample or arrival_of(state.arrivals, command.seq - 1)
    why = objection(limits, state, command, oldest, now)
    if why or oldest is None:
        return replace(state, refused=state.refused + 1, refusal=why)
    return _taken(limits, state, command, oldest, now)


def unusable(limits: SafetyLimits, command: CommandFacts) -> Fault | None:
    """Return the reason why a number of a command cannot be used; None if all can.

    A valid command must have numbers for each arm of the rig, since no arm may be moved alone. An
    invalid command requests nothing, so it may omit arms.
    """
    for index, (own, arm) in enumerate(zip(limits.arms, command.arms, strict=False)):
        if why := nonsense(own.voltage, arm.voltage_V, arm.force_mN, arm.x_d_um):
            return with_arm(why, index)
    arms, wanted = len(command.arms), len(limits.arms)
    if arms == wanted or not command.valid:
        return None
    return fault(FaultCode.OTHER_ARMS, arms=arms, wanted_arms=wanted)


def nonsense(
    limits: VoltageLimits, voltage_V: float, force_mN: float | None, x_d_um: float | None
) -> Fault | None:
    """Return the reason why a number for one arm cannot be used; None if all can."""
    if why := absurd(limits, voltage_V):
        return why
    if force_mN is not None and not isfinite(force_mN):
        return fault(FaultCode.FORCE_NOT_FINITE, force_mN=force_mN)
    if x_d_um is not None and not isfinite(x_d_um):
        return fault(FaultCode.TARGET_NOT_FINITE, x_d_um=x_d_um)
    return None


def _monitored(
    limits: SafetyLimits, state: S, command: CommandFacts, sample: Arrival, now: float
) -> S:
    """Compare force and target of each arm with its limits; only the force can end a freeze."""
    if state.mode not in (Mode.ARMED, Mode.FROZEN):
        return state
    arms = zip(limits.arms, command.arms, chain(sample.x_um, repeat(None)), strict=False)
    for index, (own, arm, x_um) in enumerate(arms):
        watches = watch_command(
            own.monitors,
            state.arms[index].watches,
            seq=command.seq,
            x_um=x_um,
            x_d_um=arm.x_d_um,
            force_mN=arm.force_mN,
        )
        state = _watched(state, index, watches)
        if state.mode == Mode.ARMED:
            found = finding(own.monitors, watches)
            state = _tripped(limits, state, index, found, now) if found else state
        elif state.mode == Mode.FROZEN:
            pressed = watches.force.found(own.monitors.force_samples)
            state = released(state, with_arm(pressed, index), now) if pressed else state
    return state


def objection(
    limits: SafetyLimits,
    state: SafetyState,
    command: CommandFacts,
    sample: Arrival | None,
    now: float,
) -> Fault | None:
    """Return the reason why a valid command with authority is not accepted; None if it is."""
    if state.mode != Mode.ARMED:
        return fault(FaultCode.NOT_ARMED, seq=command.seq)
    if command.seq <= state.taken_seq:
        return fault(FaultCode.COMMAND_REPEATED, seq=command.seq, taken_seq=state.taken_seq)
    if sample is None:
        return fault(FaultCode.SAMPLE_NOT_SEEN, seq=command.seq)
    if old := too_old(limits.age, state.arrivals, sample, now):
        return old.with_values(seq=command.seq)
    if command.sweep_V is None:
        return None
    first = state.arms[0]
    allowed = within(limits.arms[0].voltage, first.planned, first.voltage_V)
    return too_wide(allowed, command.arms[0].voltage_V, command.sweep_V)


def parts_s(limits: SafetyLimits, sample: Arrival, now: float) -> float:
    """Return the duration of a step if it is written in parts at ``now``; 0 if it is not.

    If the last part would be written a period after the sample of the command or later, and so
    after the next sample, the step is written in one part. Otherwise the estimate for the next
    sample would assume a voltage that is not yet output.
    """
    return limits.parts_s if now - sample.at_s + limits.parts_s < limits.period_s else 0.0


def _taken(limits: SafetyLimits, state: S, command: CommandFacts, sample: Arrival, now: float) -> S:
    """Apply an accepted command; a ``final`` command ends the arming and keeps the voltage."""
    if state.shaped is not None:
        state = broken_off(limits, state, now)
    had_s, share = None, 1.0
    if not limits.lockstep:
        had_s = slewing_s(limits.period_s, now - state.moved_s)
        share = had_s / limits.period_s
    arms: list[ArmOutput] = []
    still = True
    for own, arm, wanted in zip(limits.arms, state.arms, command.arms, strict=True):
        allowed = within(own.voltage, arm.planned, arm.voltage_V)
        voltage_V, flags = limited(allowed, arm.voltage_V, wanted.voltage_V, share)
        still &= voltage_V == arm.voltage_V
        arms.append(replace(arm, voltage_V=voltage_V, limits_active=flags))
    shaped = None
    shapes = limits.shaping_s is not None and command.sweep_V is None
    if shapes and parts_s(limits, sample, now):
        shaped = ShapedStep(state.arms[0].voltage_V, arms[0].voltage_V, now)
    return replace(
        state,
        mode=Mode.IDLE if command.final else Mode.ARMED,
        arms=tuple(arms),
        shaped=shaped,
        interrupted=False,
        moved_s=state.moved_s if still else now,
        slewing_s=had_s,
        part_held=command.part_held,
        taken_seq=command.seq,
        fresh_s=sample.at_s,
        blind=None,
        excused_s=0.0,
    )
