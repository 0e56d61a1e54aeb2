"""What is put out, where the output has not confirmed it: read back first, and only then moved.

A write that failed may have been heard or not, and an output that is back may have lost its
voltage with its supply. Nobody knows then what is put out, and any write may be a step. So nothing
is written until the output has said where it stands; it is asked again and again, with samples or
without; and the ramp begins from what it says.
"""

from typing import TypeVar

from msgspec.structs import replace

from pincette.control.faults import FaultCode, fault
from pincette.control.safety.causes import BOOTED, TRIPPED, Cause, Mode
from pincette.control.safety.latch import at_safe, not_located, ramped, trip
from pincette.control.safety.state import SafetyLimits, SafetyState
from pincette.control.safety.voltage import put_out

S = TypeVar("S", bound=SafetyState)


READ_BACK_V = 0.01
"""An output that says less than this beside a voltage has only rounded it."""


def waits_for_read_back(limits: SafetyLimits, state: SafetyState) -> bool:
    """Whether the output must be read back before it is written again.

    Not in lockstep, where a write ends the tick and a failure ends the run.
    """
    return not_located(limits, state) and state.mode in TRIPPED


def read_back_due(limits: SafetyLimits, state: SafetyState, now: float) -> bool:
    """Whether it is to be asked now: at once, and then once a period."""
    return waits_for_read_back(limits, state) and now - state.asked_s >= limits.period_s


def failed(state: S) -> S:
    """Note that the output has failed: nobody knows where it stands."""
    return replace(state, unconfirmed=True, located=False)


def begun(limits: SafetyLimits, state: S, found_V: float, second_V: float | None = None) -> S:
    """Begin from what is put out.

    Where that is nearer to the safe voltage than to the one that was told, the output has let a
    part go by itself; of two arms, where it is so of either.
    """
    found_V = put_out(limits.voltage, found_V)
    let_go = abs(found_V - limits.safe_V) < abs(found_V - state.voltage_V)
    second = state.second
    if limits.second is not None and second is not None and second_V is not None:
        second_V = put_out(limits.second.voltage, second_V)
        let_go |= abs(second_V - limits.safe_V) < abs(second_V - second.voltage_V)
        second = second.at(second_V)
    held = state.part_held and not let_go
    return replace(state, voltage_V=found_V, part_held=held, second=second)


def differs(state: SafetyState, found_V: float, second_V: float | None = None) -> bool:
    """Whether what is put out is another voltage than the one that was told, by more than
    rounding."""
    if abs(found_V - state.voltage_V) > READ_BACK_V:
        return True
    second = state.second
    if second is None or second_V is None:
        return False
    return abs(second_V - second.voltage_V) > READ_BACK_V


def found(
    limits: SafetyLimits, state: S, found_V: float, now: float, second_V: float | None = None
) -> S:
    """Go on from the voltage that the output has read back.

    A ramp begins anew from there, also where the actuator was latched already, and stays
    unconfirmed until a write of it is; a freeze, and the latch of a boot, keep what there is. But
    where one of two outputs has let a part go by itself, a freeze ends: the other follows.
    """
    was_held = state.part_held
    state = replace(begun(limits, state, found_V, second_V), unconfirmed=False, located=True)
    if state.mode == Mode.FROZEN and was_held and not state.part_held and state.second is not None:
        return replace(ramped(state, now), unconfirmed=True)
    kept = state.mode == Mode.FROZEN or (state.mode == Mode.LATCHED and state.cause in BOOTED)
    if kept or state.mode not in TRIPPED:
        return state
    at_rest = at_safe(limits, state)
    if not differs(at_rest, found_V, second_V):
        return at_rest
    return replace(ramped(state, now), unconfirmed=True)


def suspended(limits: SafetyLimits, state: S, slept_s: float, now: float) -> S:
    """Trip what was armed: of a sleep no age tells, and no standstill is forgiven for it.

    The output's own watchdog may have acted meanwhile, so that it is read back before anything.
    """
    told = fault(FaultCode.SUSPENDED, slept_s=slept_s)
    if state.mode == Mode.ARMED:
        state = trip(limits, state, Cause.SUSPEND, now, faults=(told,))
    return failed(state) if state.mode in TRIPPED else state


def stands(state: SafetyState) -> bool:
    """Whether the output has nothing to be told: it keeps its voltage, or stands at the safe one.

    One that has said so since it failed, and may refuse to be told, is left in peace.
    """
    if state.mode in (Mode.IDLE, Mode.FROZEN):
        return True
    return state.mode == Mode.LATCHED and state.located and not state.unconfirmed
