"""Unconfirmed output voltages: they are read back first, and moved only then.

A write that failed may have had an effect or not, and an output that is back may have lost its
voltage with its supply. The present voltage is then unknown, and any write may be a step. So
nothing is written until the output has reported its voltage. The request is repeated, with samples
or without, and the ramp begins from the reported voltage.
"""

from typing import TypeVar

from msgspec.structs import replace

from pincette.control.faults import FaultCode, fault
from pincette.control.safety.arm import ArmOutput
from pincette.control.safety.causes import BOOTED, TRIPPED, Cause, Mode
from pincette.control.safety.latch import at_safe, not_located, ramped, trip
from pincette.control.safety.state import SafetyLimits, SafetyState
from pincette.control.safety.voltage import put_out

S = TypeVar("S", bound=SafetyState)


READ_BACK_V = 0.01
"""Largest difference between a voltage and its read-back that counts as rounding, in V."""


def waits_for_read_back(limits: SafetyLimits, state: SafetyState) -> bool:
    """Return whether the output must be read back before it is written again.

    In lockstep it never must: there a write ends the tick and a failure ends the run.
    """
    return not_located(limits, state) and state.mode in TRIPPED


def read_back_due(limits: SafetyLimits, state: SafetyState, now: float) -> bool:
    """Return whether to request a read-back now: at once, and then once a period."""
    return waits_for_read_back(limits, state) and now - state.asked_s >= limits.period_s


def failed(state: S) -> S:
    """Record that the output has failed, so that its voltage is unknown."""
    return replace(state, unconfirmed=True, located=False)


def begun(limits: SafetyLimits, state: S, found_V: tuple[float, ...]) -> S:
    """Begin from the voltages at the outputs of the arms.

    An output whose voltage is nearer to the safe voltage than to the commanded one has released a
    part without a command.
    """
    arms: list[ArmOutput] = []
    let_go = False
    for arm, own, read_V in zip(state.arms, limits.arms, found_V, strict=True):
        voltage_V = put_out(own.voltage, read_V)
        let_go |= abs(voltage_V - limits.safe_V) < abs(voltage_V - arm.voltage_V)
        arms.append(replace(arm, voltage_V=voltage_V))
    held = state.part_held and not let_go
    return replace(state, arms=tuple(arms), part_held=held, shaped=None, interrupted=False)


def differs(state: SafetyState, found_V: tuple[float, ...]) -> bool:
    """Return whether an output differs from the voltage it was given by more than rounding."""
    return any(
        abs(read_V - arm.voltage_V) > READ_BACK_V
        for arm, read_V in zip(state.arms, found_V, strict=True)
    )


def found(limits: SafetyLimits, state: S, found_V: tuple[float, ...], now: float) -> S:
    """Continue from the voltages that the outputs have read back.

    A ramp begins again from there, including one of an already latched actuator, and stays
    unconfirmed until a write of it is confirmed. A freeze, and the latch of a boot, keep the
    voltages. But where one of two outputs has released a part without a command, a freeze ends: the
    other follows.
    """
    was_held = state.part_held
    state = replace(begun(limits, state, found_V), unconfirmed=False, located=True)
    released_alone = was_held and not state.part_held and len(state.arms) > 1
    if state.mode == Mode.FROZEN and released_alone:
        return replace(ramped(state, now), unconfirmed=True)
    kept = state.mode == Mode.FROZEN or (state.mode == Mode.LATCHED and state.cause in BOOTED)
    if kept or state.mode not in TRIPPED:
        return state
    at_rest = at_safe(limits, state)
    if not differs(at_rest, found_V):
        return at_rest
    return replace(ramped(state, now), unconfirmed=True)


def suspended(limits: SafetyLimits, state: S, slept_s: float, now: float) -> S:
    """Trip an armed actuator after a suspension, which no age shows and no allowance excuses.

    The output's own watchdog may have acted meanwhile, so that it is read back first.
    """
    suspension = fault(FaultCode.SUSPENDED, slept_s=slept_s)
    if state.mode == Mode.ARMED:
        state = trip(limits, state, Cause.SUSPEND, now, faults=(suspension,))
    return failed(state) if state.mode in TRIPPED else state


def needs_no_write(state: SafetyState) -> bool:
    """Return whether no write is needed: the voltage is to stay, or is the confirmed safe one.

    An output that has reported the safe voltage since its failure, and may refuse commands, is not
    written again. A step that was broken off between two parts must be written.
    """
    if state.interrupted:
        return False
    if state.mode in (Mode.IDLE, Mode.FROZEN):
        return True
    return state.mode == Mode.LATCHED and state.located and not state.unconfirmed
