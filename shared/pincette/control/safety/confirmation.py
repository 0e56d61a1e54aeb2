"""Handling of unconfirmed output voltages: they are read back before they are changed.

A failed write may or may not have had an effect, and an output that responds again may have lost
its voltage with its supply. The present voltage is then unknown, and any write could cause a step.
So nothing is written until the output has reported its voltage. The request is repeated, whether
samples arrive or not, and the ramp begins at the reported voltage.
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
"""Largest difference between a voltage and its read-back that is attributed to rounding, in V."""


def waits_for_read_back(limits: SafetyLimits, state: SafetyState) -> bool:
    """Return whether the output must be read back before it is written again.

    In lockstep no read-back is needed: a write ends the tick, and a failure ends the run.
    """
    return not_located(limits, state) and state.mode in TRIPPED


def read_back_due(limits: SafetyLimits, state: SafetyState, now: float) -> bool:
    """Return whether to request a read-back now: immediately, and then once per period."""
    return waits_for_read_back(limits, state) and now - state.asked_s >= limits.period_s


def failed(state: S) -> S:
    """Record that the output has failed, so that its voltage is unknown."""
    return replace(state, unconfirmed=True, located=False)


def begun(limits: SafetyLimits, state: S, found_V: tuple[float, ...]) -> S:
    """Initialise the state from the voltages at the outputs of the arms.

    If the voltage of an output is nearer to the safe voltage than to the commanded one, the output
    has released a part without a command.
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
    """Return whether an output differs from its commanded voltage by more than rounding."""
    return any(
        abs(read_V - arm.voltage_V) > READ_BACK_V
        for arm, read_V in zip(state.arms, found_V, strict=True)
    )


def found(limits: SafetyLimits, state: S, found_V: tuple[float, ...], now: float) -> S:
    """Continue from the voltages that were read back from the outputs.

    A ramp restarts from these voltages, even if the actuator was already latched, and stays
    unconfirmed until one of its writes is confirmed. A freeze, and the latch set at startup, keep
    the voltages. But if one of two outputs has released a part without a command, a freeze ends, so
    that the other output releases it too.
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
    """Trip an armed actuator after a suspension of the machine, during which the clock stood still.

    The watchdog of the output may have acted in the meantime, so the output is read back first.
    """
    suspension = fault(FaultCode.SUSPENDED, slept_s=slept_s)
    if state.mode == Mode.ARMED:
        state = trip(limits, state, Cause.SUSPEND, now, faults=(suspension,))
    return failed(state) if state.mode in TRIPPED else state


def needs_no_write(state: SafetyState) -> bool:
    """Return whether no write is needed: the voltage stays, or is the confirmed safe voltage.

    An output that has reported the safe voltage since its failure is not written again, because it
    may refuse commands. A step that was interrupted between two parts must be written.
    """
    if state.interrupted:
        return False
    if state.mode in (Mode.IDLE, Mode.FROZEN):
        return True
    return state.mode == Mode.LATCHED and state.located and not state.unconfirmed
