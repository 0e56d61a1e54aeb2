"""What the actuator is asked: to be armed, to trip, to be reset."""

from pincette.control.replacing import replace
from pincette.control.safety.causes import as_asked
from pincette.control.safety.freshness import newest_seq
from pincette.control.safety.latch import (
    armed,
    arming_objection,
    reset,
    reset_objection,
    trip,
)
from pincette.control.safety.state import SafetyLimits
from pincette.messages import Arm, Done, Message, Reset, Trip
from pincette.service import Drive, ForInstrument, RefusedError
from pincette_actuator.state import State
from pincette_actuator.wire import applied_of

Answer = tuple[State, Message, tuple[Message | ForInstrument, ...]]


def answer(limits: SafetyLimits, state: State, request: Message, now: float) -> Answer:
    """Arm, trip or reset; raises RefusedError."""
    if isinstance(request, Arm):
        return _arm(limits, state, request, now)
    if isinstance(request, Trip):
        cause = as_asked(request.cause)
        after = trip(limits, state, cause, now, let_go=request.let_go).settled()
        return _told(limits, state, after)
    if isinstance(request, Reset):
        if why := reset_objection(limits, state, acknowledged=request.acknowledge):
            raise RefusedError(why)
        return _told(limits, state, reset(limits, state))
    raise RefusedError(f"the actuator does not answer {type(request).__name__}")


def _arm(limits: SafetyLimits, state: State, request: Arm, now: float) -> Answer:
    if why := arming_objection(state):
        raise RefusedError(why)
    state = armed(limits, state, epoch=request.epoch, owner=request.owner, now=now)
    state = replace(state, pending=None, sweep=None, answered_seq=-1)
    return state, Done(-1), (applied_of(state, -1),)


def _told(limits: SafetyLimits, before: State, state: State) -> Answer:
    """The state as it is; in lockstep a tick that is under way says it at its own end.

    There a voltage that has moved outside a tick is put out at once.
    """
    seq = newest_seq(state.arrivals)
    applied = applied_of(state, seq)
    said = (applied,) if applied.final or not limits.lockstep else ()
    moved = limits.lockstep and applied.final and state.voltage_V != before.voltage_V
    return state, Done(seq), (Drive(state.voltage_V), *said) if moved else said
