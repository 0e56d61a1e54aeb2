"""Requests to the controller: load a program, arm, act, renew the lease."""

from msgspec.structs import replace

from pincette.control.safety.monitors import UNSEEN
from pincette.core.faults import FaultCode
from pincette.core.messages import Ack, Action, Arm, Lease, Load, Message
from pincette.core.service import RefusedError
from pincette_controller.actions import RunningLease, action_objection, lease_objection
from pincette_controller.config import ControllerConfig, check_program
from pincette_controller.state import State


def handle(
    config: ControllerConfig, state: State, request: Message, now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Load a program, begin an epoch with it, or accept an action."""
    if isinstance(request, Load):
        try:
            check_program(config, request.program)
        except ValueError as error:
            raise RefusedError(str(error)) from error
        return replace(state, loaded=request.program), Ack(state.seq), ()
    if isinstance(request, Arm):
        if state.loaded is None:
            raise RefusedError("the controller has no program: load one first")
        try:
            laws = config.laws(state.loaded)
        except ValueError as error:
            raise RefusedError(f"a law of the program: {error}") from error
        models = zip(state.memories, config.arms, strict=True)
        fresh = State(
            tuple(memory.armed(arm.response) for memory, arm in models),
            (UNSEEN,) * len(config.arms),
            epoch=request.epoch,
            owner=request.owner,
            loaded=state.loaded,
            program=state.loaded,
            laws=laws,
            playing=True,
            refused=state.refused,
        )
        return fresh, Ack(0), ()
    if isinstance(request, Action):
        return _note(state, request)
    if isinstance(request, Lease):
        return _lease(state, request, now)
    raise RefusedError(f"the controller does not answer {type(request).__name__}")


def _lease(state: State, lease: Lease, now: float) -> tuple[State, Message, tuple[Message, ...]]:
    ended = state.found is not None and state.found.code is FaultCode.LEASE_ENDED
    if why := lease_objection(lease, state.epoch, playing=state.playing, ended=ended):
        raise RefusedError(why)
    return replace(state, lease=RunningLease(lease, now)), Ack(state.seq), ()


def _note(state: State, request: Action) -> tuple[State, Message, tuple[Message, ...]]:
    if not state.playing:
        raise RefusedError(f"no program runs: {request.action} cannot act")
    if why := action_objection(state.pending, state.player, request.action):
        raise RefusedError(why)
    if request.at_seq is not None and request.at_seq <= state.seq:
        raise RefusedError(f"seq {request.at_seq} has passed, the controller is at {state.seq}")
    seq = state.seq + 1 if request.at_seq is None else request.at_seq
    return replace(state, pending=(*state.pending, request)), Ack(seq), ()
