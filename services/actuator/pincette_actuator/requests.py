"""Requests to the actuator: arm, trip, reset."""

from msgspec.structs import replace

from pincette.control.faults import FaultCode, fault
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
from pincette.core.messages import Ack, Arm, Message, Reset, Trip
from pincette.core.service import DeviceCommand, RefusedError, SetVoltage
from pincette_actuator.state import State, applied_of, voltages_of

Answer = tuple[State, Message, tuple[Message | DeviceCommand, ...]]


def handle(limits: SafetyLimits, state: State, request: Message, now: float) -> Answer:
    """Arm, trip or reset; raises RefusedError."""
    if isinstance(request, Arm):
        return _arm(limits, state, request, now)
    if isinstance(request, Trip):
        words = (fault(FaultCode.REQUESTED, request.words),) if request.words else ()
        after = trip(
            limits, state, as_asked(request.cause), now, faults=words, let_go=request.release_now
        ).settled()
        return _answer(limits, state, after)
    if isinstance(request, Reset):
        if why := reset_objection(limits, state, acknowledged=request.acknowledge):
            raise RefusedError(why)
        return _answer(limits, state, reset(limits, state))
    raise RefusedError(f"the actuator does not answer {type(request).__name__}")


def _arm(limits: SafetyLimits, state: State, request: Arm, now: float) -> Answer:
    if why := arming_objection(state):
        raise RefusedError(why)
    state = armed(
        limits,
        state,
        epoch=request.epoch,
        owner=request.owner,
        now=now,
        planned=request.voltages,
    )
    state = replace(state, pending=None, sweep=None, answered_seq=-1)
    return state, Ack(-1), (applied_of(state, -1),)


def _answer(limits: SafetyLimits, before: State, state: State) -> Answer:
    """Publish the state; in lockstep a running tick does so when it ends.

    A voltage that was changed outside a tick is output at once.
    """
    seq = newest_seq(state.arrivals)
    applied = applied_of(state, seq)
    echo = (applied,) if applied.final or not limits.lockstep else ()
    order = SetVoltage(voltages_of(state))
    if state.interrupted:
        return replace(state, interrupted=False), Ack(seq), (order, *echo)
    moved = limits.lockstep and applied.final and voltages_of(state) != voltages_of(before)
    return state, Ack(seq), (order, *echo) if moved else echo
