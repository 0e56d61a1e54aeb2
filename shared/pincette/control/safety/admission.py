"""Which commands may act: authority, numbers, order, sample, age; and what a good one does.

A command is heard only from the owner and in the epoch that the arming named. What it knows of its
sample is held against the hard limits whether it is valid or not; then it is taken or refused.
"""

from math import isfinite
from typing import TypeVar

from msgspec.structs import replace

from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.record import FrozenRecord
from pincette.control.safety.causes import Mode
from pincette.control.safety.freshness import (
    ARRIVALS_KEPT,
    Arrival,
    arrival_of,
    newest_seq,
    too_old,
    with_sample,
)
from pincette.control.safety.latch import released, trip
from pincette.control.safety.monitors import Finding, finding, watch_command, watch_position
from pincette.control.safety.second import SecondFacts, second_finding
from pincette.control.safety.state import SafetyLimits, SafetyState, Strangers
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
    """What the safety rules know of a command."""

    epoch: int
    owner: int
    seq: int
    """Of the sample that it is based on."""
    voltage_V: float
    part_held: bool
    final: bool
    valid: bool
    fault: Fault | None = None
    """Why it is not valid; None where it is, or does not say."""
    force_mN: float | None = None
    x_d_um: float | None = None
    sweep_V: float | None = None
    """Amplitude of a sweep about the voltage; None: without one."""
    second: SecondFacts | None = None
    """Of the second arm."""


def sampled(
    limits: SafetyLimits,
    state: S,
    seq: int,
    x_um: float | None,
    now: float,
    second_um: float | None = None,
) -> S:
    """Note a sample of this epoch, in µm (None: no measurement), and hold it against the limits.

    An older or equal number changes nothing.
    """
    if seq <= newest_seq(state.arrivals):
        return state
    state = replace(state, arrivals=with_sample(state.arrivals, seq, now, x_um, second_um))
    if state.mode != Mode.ARMED:
        return state
    if x_um is not None:
        watches = watch_position(limits.monitors, state.watches, x_um)
        if watches is not state.watches:
            state = replace(state, watches=watches)
            if found := finding(limits.monitors, watches):
                state = _tripped(limits, state, found, now)
    return state if second_um is None else second_sampled(limits, state, second_um, now)


def second_sampled(limits: SafetyLimits, state: S, x_um: float, now: float) -> S:
    """Hold a sample of the second arm against its limits."""
    second, own = state.second, limits.second
    if second is None or own is None:
        return state
    watches = watch_position(own.monitors, second.watches, x_um)
    state = replace(state, second=replace(second, watches=watches))
    found = second_finding(own.monitors, watches)
    return _tripped(limits, state, found, now) if found else state


def _tripped(limits: SafetyLimits, state: S, found: Finding, now: float) -> S:
    return trip(limits, state, found.cause, now, faults=(found.fault,))


def unheard(state: SafetyState, command: CommandFacts) -> Fault | None:
    """Why a command is not listened to at all; None where it is.

    Without authority, or so far ahead of the samples that it cannot have overtaken its own.
    """
    if command.epoch != state.epoch:
        return fault(FaultCode.OTHER_EPOCH, epoch=command.epoch, armed_epoch=state.epoch)
    if command.owner != state.owner:
        return fault(FaultCode.OTHER_OWNER, owner=command.owner, armed_owner=state.owner)
    newest = newest_seq(state.arrivals)
    if command.seq > newest + ARRIVALS_KEPT:
        return fault(FaultCode.COMMAND_AHEAD, seq=command.seq, newest_seq=newest)
    return None


def turned_away(state: S, command: CommandFacts, why: Fault) -> S:
    """Count a command that is not listened to; several of strangers are an alarm.

    One that is not valid asks for nothing: a controller says so of every sample before it is armed.
    """
    if not command.valid:
        return state
    strangers = Strangers(state.strangers.count + 1, why)
    return replace(state, refused=state.refused + 1, refusal=why, strangers=strangers)


def early(state: SafetyState, command: CommandFacts) -> bool:
    """Whether a command has overtaken its sample, and must wait for it."""
    return command.seq > newest_seq(state.arrivals)


def judged(limits: SafetyLimits, state: S, command: CommandFacts, now: float) -> S:
    """Take a command that is listened to, or refuse it, or trip by what it knows.

    One that is not valid is never taken; why it is not is remembered for the trip that may follow.
    """
    why = nonsense(limits.voltage, command.voltage_V, command.force_mN, command.x_d_um)
    if why is None and (limits.second is not None or command.second is not None):
        why = second_objection(limits, command)
    if why:
        why = why.with_values(seq=command.seq)
        return replace(state, refused=state.refused + 1, refusal=why)
    sample = arrival_of(state.arrivals, command.seq)
    if sample is not None:
        state = _monitored(limits, state, command, sample, now)
    if not command.valid:
        return replace(state, blind=command.fault)
    # A sample that was lost on its way here is no older than the one before it.
    oldest = sample or arrival_of(state.arrivals, command.seq - 1)
    why = objection(limits, state, command, oldest, now)
    if why or oldest is None:
        return replace(state, refused=state.refused + 1, refusal=why)
    return _taken(limits, state, command, oldest, now)


def nonsense(
    limits: VoltageLimits, voltage_V: float, force_mN: float | None, x_d_um: float | None
) -> Fault | None:
    """Why a number of a command may not be used; None where all may."""
    if why := absurd(limits, voltage_V):
        return why
    if force_mN is not None and not isfinite(force_mN):
        return fault(FaultCode.FORCE_NOT_FINITE, force_mN=force_mN)
    if x_d_um is not None and not isfinite(x_d_um):
        return fault(FaultCode.TARGET_NOT_FINITE, x_d_um=x_d_um)
    return None


def second_objection(limits: SafetyLimits, command: CommandFacts) -> Fault | None:
    """Why the second arm's part of a command may not be used; None where it may.

    On a rig of two arms it must be there: one arm is never moved alone by leaving the other out.
    A command that is not valid asks for nothing, and needs none.
    """
    own, second = limits.second, command.second
    if own is None or second is None:
        if (own is None) == (second is None) or not command.valid:
            return None
        arms = 1 if own is None else 2
        return fault(FaultCode.OTHER_ARMS, arms=3 - arms, wanted_arms=arms)
    why = nonsense(own.voltage, second.voltage_V, second.force_mN, second.x_d_um)
    return why and why.with_values(arm=2)


def _monitored(
    limits: SafetyLimits, state: S, command: CommandFacts, sample: Arrival, now: float
) -> S:
    """Hold force and aim against the hard limits; a freeze is released by the force alone."""
    if state.mode not in (Mode.ARMED, Mode.FROZEN):
        return state
    watches = watch_command(
        limits.monitors,
        state.watches,
        seq=command.seq,
        x_um=sample.x_um,
        x_d_um=command.x_d_um,
        force_mN=command.force_mN,
    )
    state = replace(state, watches=watches)
    if state.mode == Mode.ARMED:
        if found := finding(limits.monitors, watches):
            state = _tripped(limits, state, found, now)
    elif pressed := watches.force.found(limits.monitors.force_samples):
        state = released(state, pressed, now)
    second, own = state.second, limits.second
    if command.second is None or second is None or own is None:
        return state
    watches = watch_command(
        own.monitors,
        second.watches,
        seq=command.seq,
        x_um=sample.second_um,
        x_d_um=command.second.x_d_um,
        force_mN=command.second.force_mN,
    )
    state = replace(state, second=replace(second, watches=watches))
    if state.mode == Mode.ARMED:
        found = second_finding(own.monitors, watches)
        return _tripped(limits, state, found, now) if found else state
    pressed = watches.force.found(own.monitors.force_samples)
    if pressed is None or state.mode != Mode.FROZEN:
        return state
    return released(state, pressed.with_values(arm=2), now)


def objection(
    limits: SafetyLimits,
    state: SafetyState,
    command: CommandFacts,
    sample: Arrival | None,
    now: float,
) -> Fault | None:
    """Why a valid command that is listened to is not taken; None where it may be."""
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
    allowed = within(limits.voltage, state.planned, state.voltage_V)
    return too_wide(allowed, command.voltage_V, command.sweep_V)


def _taken(limits: SafetyLimits, state: S, command: CommandFacts, sample: Arrival, now: float) -> S:
    """Follow a good command; ``final`` ends the arming and keeps the voltage."""
    had_s, share = None, 1.0
    if not limits.lockstep:
        had_s = slewing_s(limits.period_s, now - state.moved_s)
        share = had_s / limits.period_s
    allowed = within(limits.voltage, state.planned, state.voltage_V)
    voltage_V, flags = limited(allowed, state.voltage_V, command.voltage_V, share)
    second, still = state.second, voltage_V == state.voltage_V
    if second is not None and limits.second is not None and command.second is not None:
        allowed = within(limits.second.voltage, state.second_planned, second.voltage_V)
        own_V, own_flags = limited(allowed, second.voltage_V, command.second.voltage_V, share)
        still &= own_V == second.voltage_V
        second = replace(second, voltage_V=own_V, limits_active=own_flags)
    return replace(
        state,
        mode=Mode.IDLE if command.final else Mode.ARMED,
        voltage_V=voltage_V,
        second=second,
        moved_s=state.moved_s if still else now,
        slewing_s=had_s,
        part_held=command.part_held,
        taken_seq=command.seq,
        fresh_s=sample.at_s,
        limits_active=flags,
        blind=None,
        excused_s=0.0,
    )
