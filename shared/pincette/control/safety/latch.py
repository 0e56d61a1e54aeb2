"""Arming, trip, freeze, ramp, latch and reset: the modes and the transitions between them.

The reaction to a trip is determined before the fault: the last accepted command states whether a
part is held. If the arm is free, the voltage ramps to the safe value. If a part is held, the
voltage is frozen for a limited time and up to a limited force, and then ramped, unless the cause
requires an immediate release. In both cases the actuator is latched until an operator resets it,
and nothing resumes automatically. A reset during a freeze keeps the part, at the voltage that holds
it.

The latch set at startup needs no acknowledgement if there was no actuator before, or if the last
one ended on request without anything to report. After any other end the cause is that the previous
program died.
"""

from itertools import chain, repeat
from typing import TypeVar

from msgspec.structs import replace

from pincette.control.faults import Fault, FaultCode, fault
from pincette.control.safety.arm import ArmOutput
from pincette.control.safety.causes import AT_REST, BOOTED, LETS_GO, Cause, Mode, Predecessor
from pincette.control.safety.freshness import standstill_s
from pincette.control.safety.state import NO_UNAUTHORIZED, SafetyLimits, SafetyState
from pincette.control.safety.voltage import ramp
from pincette.control.voltage_range import VoltageRange

S = TypeVar("S", bound=SafetyState)


def booted(state: S, predecessor: Predecessor) -> S:
    """Return the state latched at startup; the cause is a restart if the last program died."""
    cause = Cause.RESTART if predecessor is Predecessor.DIED else Cause.BOOT
    return replace(state, cause=cause, predecessor=predecessor)


def ending(state: SafetyState) -> Predecessor:
    """Return how the end of the actuator in this state is reported to its successor.

    If the latch of its own start has not been reset, the report about its predecessor is passed on.
    """
    if state.part_held or state.unconfirmed:
        return Predecessor.DIED
    if state.mode == Mode.IDLE:
        return Predecessor.CLEAN
    if state.mode == Mode.LATCHED and state.cause == Cause.BOOT:
        return state.predecessor
    return Predecessor.DIED


def arming_objection(state: SafetyState) -> str:
    """Return the reason why the actuator may not be armed; empty if it may.

    If the program that armed the actuator ended before the loop began, no sample can end that
    arming, so another arming may replace it.
    """
    if state.mode == Mode.IDLE or (state.mode == Mode.ARMED and not state.arrivals):
        return ""
    hint = "reset it first" if state.mode == Mode.LATCHED else "wait until it has ended"
    return f"the actuator is {state.mode} ({state.cause or 'armed'}): {hint}"


def armed(
    limits: SafetyLimits,
    state: S,
    *,
    epoch: int,
    owner: int,
    now: float,
    planned: tuple[VoltageRange | None, ...] = (),
) -> S:
    """Give the authority to one owner for one epoch, with the present voltage and part.

    A held part counts as held until the first command states otherwise: a fault before that must
    not release it.

    Parameters
    ----------
    planned
        Voltage range of the plan for each arm; None: the limits of the rig.
    """
    plans = chain(planned, repeat(None))
    return replace(
        state,
        mode=Mode.ARMED,
        cause=Cause.NONE,
        faults=(),
        epoch=epoch,
        owner=owner,
        taken_seq=-1,
        fresh_s=now + limits.age.grace_s,
        ran_s=now,
        arrivals=(),
        since_s=0.0,
        blind=None,
        arms=tuple([ArmOutput(arm.voltage_V, planned=next(plans)) for arm in state.arms]),
        excused_s=0.0,
        refusal=None,
        unauthorized=NO_UNAUTHORIZED,
        shaped=None,
    )


def trip(
    limits: SafetyLimits,
    state: S,
    cause: Cause,
    now: float,
    *,
    faults: tuple[Fault, ...] = (),
    let_go: bool = False,
) -> S:
    """Enter the safe state, unless already in it; the first cause is kept.

    A part is released only on request, or if the cause requires it; a freeze then becomes a ramp
    immediately. In lockstep, an actuator that is not armed gets no more ticks to play a ramp: it
    keeps its voltage, or sets the safe voltage immediately if a release is required.
    """
    let_go = let_go or cause in LETS_GO
    if state.mode == Mode.FROZEN and let_go:
        return ramped(state, now)
    tripped_before = state.mode == Mode.LATCHED and state.cause not in BOOTED
    if state.mode in (Mode.FROZEN, Mode.RAMPING) or tripped_before:
        return state
    state = broken_off(limits, state, now)
    arms = tuple([replace(arm, limits_active=0) for arm in state.arms])
    tripped = replace(state, cause=cause, faults=faults, since_s=now, arms=arms)
    if limits.lockstep and state.mode != Mode.ARMED:
        return at_safe(limits, tripped) if let_go else replace(tripped, mode=Mode.LATCHED)
    keeps = state.part_held and not let_go
    return replace(tripped, mode=Mode.FROZEN) if keeps else ramped(tripped, now)


def standing_V(limits: SafetyLimits, state: SafetyState, now: float) -> float:
    """Return the voltage of the first arm, in V; in a step in parts, that of the newest part."""
    step, interval_s = state.shaped, limits.shaping_s
    if step is None or interval_s is None or limits.lockstep:
        return state.arms[0].voltage_V
    return step.reached_V(now, interval_s, limits.arms[0].voltage.step_V)


def broken_off(limits: SafetyLimits, state: S, now: float) -> S:
    """Stop a step in parts after the part that has been output."""
    if state.shaped is None:
        return state
    voltage_V, (first, *others) = standing_V(limits, state, now), state.arms
    interrupted = voltage_V != first.voltage_V
    arms = (replace(first, voltage_V=voltage_V), *others)
    return replace(state, arms=arms, shaped=None, interrupted=interrupted)


def explained(state: S, found: Fault) -> S:
    """Add late samples of the sensor to the faults of a trip caused by missing commands.

    At first late samples look lost; only their arrival after the trip shows that they were late.
    """
    late = any(one.code is FaultCode.INSTRUMENT_LATE for one in state.faults)
    if state.cause != Cause.COMMAND_AGE or state.mode == Mode.ARMED or late:
        return state
    if found.code is not FaultCode.INSTRUMENT_LATE:
        return state
    return replace(state, faults=(*state.faults, found))


def ramped(state: S, now: float) -> S:
    """Begin the ramp of each arm from its present voltage to the safe voltage."""
    arms = tuple([replace(arm, ramp_from_V=arm.voltage_V) for arm in state.arms])
    return replace(state, mode=Mode.RAMPING, since_s=now, arms=arms)


def at_safe(limits: SafetyLimits, state: S) -> S:
    """Return the state latched at the safe voltage, without a part."""
    arms = tuple([replace(arm, voltage_V=limits.safe_V) for arm in state.arms])
    return replace(state, mode=Mode.LATCHED, arms=arms, part_held=False)


def released(state: S, pressed: Fault, now: float) -> S:
    """End a freeze because the part seems to be pressed too hard, and add a fault with the force.

    The force is estimated from the voltage. If the output has not confirmed the voltage, the force
    is unknown and the fault contains no number.
    """
    values = pressed.values
    if state.unconfirmed:
        values = tuple(
            replace(item, value=None) if item.name == "force_mN" else item for item in values
        )
    found = Fault(FaultCode.FREEZE_RELEASED, values)
    return ramped(replace(state, faults=(*state.faults, found)), now)


def reset_objection(limits: SafetyLimits, state: SafetyState, *, acknowledged: bool) -> str:
    """Return the reason why the latch cannot be reset; empty if it can.

    The cause must be acknowledged, except for the latch of a start after a clean end.
    """
    if not acknowledged and (state.mode != Mode.LATCHED or state.cause != Cause.BOOT):
        return "a reset needs acknowledge = true"
    if state.mode == Mode.RAMPING and not limits.lockstep:
        return f"the actuator is ramping ({state.cause}): reset it once the arm is safe"
    return ""


def reset(limits: SafetyLimits, state: S) -> S:
    """Reset the latch; a held part stays held, at the same voltage.

    In real time a ramp must have ended. In lockstep a ramp may be unfinished: if a program has
    died, no tick will come to finish it.
    """
    if state.mode == Mode.RAMPING:
        state = at_safe(limits, state)
    if state.mode not in (Mode.LATCHED, Mode.FROZEN):
        return state
    return replace(
        state, mode=Mode.IDLE, cause=Cause.NONE, faults=(), unconfirmed=False, located=False
    )


def account_for_stall(limits: SafetyLimits, state: S, now: float, busy_s: float = 0.0) -> S:
    """Record that the actuator runs, and subtract an earlier stall from every age.

    At rest nothing ages, and the actuator checks its clock less often. The time ``busy_s`` in which
    its program worked for another service is not a stall.
    """
    if limits.lockstep or state.ran_s is None or state.mode in AT_REST:
        return replace(state, ran_s=now)
    stood_s = standstill_s(limits.age, now - state.ran_s - busy_s, state.excused_s)
    if stood_s is None:
        return replace(state, ran_s=now)
    return replace(
        state,
        ran_s=now,
        fresh_s=state.fresh_s + stood_s,
        since_s=state.since_s + stood_s,
        excused_s=state.excused_s + stood_s,
        standstills=state.standstills + 1,
    )


def not_located(limits: SafetyLimits, state: SafetyState) -> bool:
    """Return whether the output has failed and not reported its voltage since.

    In lockstep the result is always False.
    """
    return state.unconfirmed and not state.located and not limits.lockstep


def pass_time(limits: SafetyLimits, state: S, now: float) -> S:
    """Apply the rules that depend on time: the age limit, the end of a freeze, the ramp."""
    if state.mode == Mode.ARMED and now - state.fresh_s > limits.age.limit_s:
        state = trip(limits, state, Cause.COMMAND_AGE, now, faults=_silence(limits, state, now))
    if state.mode == Mode.FROZEN and now - state.since_s >= limits.freeze_s:
        state = ramped(state, now)
    if state.mode != Mode.RAMPING:
        return state
    # Add one step, since the first step of the ramp is made at the trip.
    share = (now - state.since_s + limits.age.wake_s) / limits.ramp_s
    if not_located(limits, state):
        # Nothing is written until the output is read back: see ``confirmation``.
        over = replace(state, mode=Mode.LATCHED, part_held=False)
        return over if share >= 1.0 else state
    if share >= 1.0:
        return replace(at_safe(limits, state), moved_s=now)
    arms = [
        replace(arm, voltage_V=ramp(arm.ramp_from_V, limits.safe_V, share)) for arm in state.arms
    ]
    return replace(state, arms=tuple(arms), moved_s=now)


def _silence(limits: SafetyLimits, state: SafetyState, now: float) -> tuple[Fault, ...]:
    silent = fault(FaultCode.NO_COMMAND, silent_s=now - state.fresh_s, limit_s=limits.age.limit_s)
    return (silent,) if state.blind is None else (silent, state.blind)


def shutdown(limits: SafetyLimits, state: S, now: float) -> tuple[S, bool]:
    """Ramp to the safe voltage because the program is about to end, with or without a part.

    The second result is True once the voltage is safe.
    """
    at_safe_voltage = all(arm.voltage_V == limits.safe_V for arm in state.arms)
    if at_safe_voltage and standing_V(limits, state, now) == limits.safe_V:
        return state, True
    if state.mode != Mode.RAMPING:
        cause = state.cause or Cause.SHUTDOWN
        state = broken_off(limits, state, now)
        state = ramped(replace(state, cause=cause, part_held=False), now)
    return state, False
