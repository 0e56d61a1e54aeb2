"""The controller as a service: an estimate in, a command and the controller's own view out."""

from typing import NamedTuple

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.control.laws import law as control_law
from pincette.control.laws.law import Law, LawState
from pincette.control.planning.program import Program
from pincette.control.record import FrozenRecord
from pincette.control.safety.monitors import UNSEEN, Watches
from pincette.control.safety.voltage import SLEW_DOWN, SLEW_UP, VOLTAGE_MAX, VOLTAGE_MIN
from pincette.core.faults import Fault, FaultCode, Outcome
from pincette.core.messages import (
    Ack,
    Action,
    Arm,
    Command,
    Estimate,
    Lease,
    Load,
    Message,
    RequestLog,
)
from pincette.core.service import DeviceCommand, Input, RefusedError, Service
from pincette.core.topics import (
    ACTION,
    ARM,
    COMMAND,
    ESTIMATE,
    LEASE,
    LOAD,
    STATUS,
    TELEMETRY,
    TIMING_OF,
)
from pincette_controller.actions import (
    RunningLease,
    act,
    acted_in_tick,
    action_objection,
    lease_end,
    lease_objection,
)
from pincette_controller.arm_memory import ArmMemory
from pincette_controller.config import ControllerConfig, configure
from pincette_controller.outputs import (
    check_command,
    invalid_command,
    no_command,
    number_out_of_bounds,
    telemetry_of,
    zeroed_force_mN,
)
from pincette_controller.player import advance, begin
from pincette_controller.player_state import Player

RAISING, LOWERING = VOLTAGE_MAX | SLEW_UP, VOLTAGE_MIN | SLEW_DOWN
"""Bits of ``limits_active`` that keep the voltage from rising, and from falling."""
TRIPPED = Fault(FaultCode.ACTUATOR_TRIPPED)


class Inputs(NamedTuple):
    """The estimate of the newest sample."""

    estimate: Estimate | None


class State(FrozenRecord, frozen=True):
    """The program, where it stands, and the memory of law and arm."""

    arm: ArmMemory
    """It outlives an arming, as the arm's own does."""
    epoch: int = 0
    owner: int = 0
    seq: int = -1
    loaded: Program | None = None
    """What the next arming plays; loading it does not touch what plays now."""
    program: Program | None = None
    playing: bool = False
    laws: tuple[Law, ...] = ()
    """Those of ``program``."""
    player: Player | None = None
    memory: LawState | None = None
    pending: tuple[Action, ...] = ()
    lease: RunningLease | None = None
    """Without one the program plays to its end, with or without a supervisor."""
    watches: Watches = UNSEEN
    """What the check of the hard limits has seen."""
    silenced: Fault | None = None
    """Why it commands no more, though no action has ended the program."""
    refused: int = 0
    found: Fault | None = None
    """Why it has stopped, or stops, without an action that asks for it."""

    @property
    def findings(self) -> tuple[Fault, ...]:
        """Faults of this program that people see."""
        return () if self.found is None else (self.found,)


def start(config: ControllerConfig) -> State:
    """Nothing is loaded."""
    return State(ArmMemory(config.response, config.response))


def step(
    config: ControllerConfig, state: State, inputs: Inputs, now: float
) -> tuple[State, tuple[Message | DeviceCommand, ...]]:
    """Answer an estimate with a command; the stop by an ended lease acts with the next one."""
    state, outputs = _answer(config, state, inputs.estimate)
    if state.lease is None or not state.playing:
        return state, outputs
    outcome = Outcome.NONE if state.player is None else state.player.outcome
    if (action := lease_end(state.lease, outcome, now)) is None:
        return state, outputs
    log = RequestLog(state.epoch, state.seq, SERVICE.name, ESTIMATE.name, action=action)
    ended = replace(state, pending=(*state.pending, action), lease=None, found=action.reason)
    return ended, (*outputs, log)


def _answer(
    config: ControllerConfig, state: State, estimate: Estimate | None
) -> tuple[State, tuple[Message | DeviceCommand, ...]]:
    if estimate is None:
        return state, ()
    if estimate.epoch != state.epoch:
        return replace(state, refused=state.refused + 1), ()
    state = replace(state, arm=state.arm.follow(estimate, config.period_s))
    if state.playing and estimate.valid and not estimate.tripped and state.program is not None:
        return _play(config, state, state.program, estimate)
    state = replace(state, seq=estimate.seq)
    if estimate.tripped and state.playing:
        state = replace(state, playing=False, pending=(), found=TRIPPED)
    return state, (no_command(estimate, state.epoch, state.owner, state.silenced),)


def _play(
    config: ControllerConfig, state: State, program: Program, estimate: Estimate
) -> tuple[State, tuple[Message | DeviceCommand, ...]]:
    before = state.player or begin(program, estimate.x_um, estimate.applied_V)
    arm_memory = state.arm.for_law
    memory = state.memory or control_law.start(
        state.laws[before.segment.law],
        x_um=estimate.x_um,
        x_r_um=estimate.x_um,
        force_mN=0.0,
        applied_V=estimate.applied_V,
        memory=arm_memory,
    )
    player, later, effects = act(program, before, state.pending, estimate.seq, estimate.x_um)
    player = advance(program, player, estimate, config.period_s)
    law = state.laws[player.segment.law]
    force_mN = estimate.force_mN if player.pressing else 0.0
    force_r_mN = player.force_r_mN if player.pressing else 0.0
    if player.segment.open_loop:
        pressed_mN = estimate.force_mN if player.held else 0.0
        player = replace(player, x_r_um=estimate.x_um, speed_um_per_s=0.0, force_r_mN=pressed_mN)
    steered = state.memory is not None and not player.segment.open_loop
    anew = player.bump or player.segment.open_loop or player.pressing != before.pressing
    if anew or player.segment.law != before.segment.law:
        # Another law alone: the references go on, and the newest sample belongs to those before.
        known = player if anew else before
        memory = control_law.rebase(
            law,
            memory,
            x_um=estimate.x_um,
            x_r_um=known.x_r_um,
            force_mN=force_mN,
            force_r_mN=known.force_r_mN if player.pressing else 0.0,
            seen_V=control_law.other_view(
                law, state.laws[before.segment.law], estimate.applied_V, arm_memory
            ),
        )
    after, output = control_law.step(
        law,
        memory,
        x_um=estimate.x_um,
        force_mN=force_mN,
        applied_V=estimate.applied_V,
        x_r_um=player.x_r_um,
        force_r_mN=force_r_mN,
        limited=_limited(estimate.limits_active),
        memory=arm_memory,
    )
    voltage_V = player.voltage_V if player.segment.open_loop else output.voltage_V
    command = Command(
        epoch=state.epoch,
        seq=estimate.seq,
        owner=state.owner,
        voltage_V=estimate.applied_V if player.ended else voltage_V,
        part_held=player.held,
        zero=player.zero,
        final=player.ended,
        valid=True,
        sweep=None if player.ended else player.segment.sweep,
        force_mN=zeroed_force_mN(estimate),
        x_d_um=None if player.ended or not steered else memory.x_d_um,
    )
    watches, command = check_command(config, state.watches, command, estimate)
    acted = acted_in_tick(effects, before, player)
    telemetry = telemetry_of(estimate, before, memory, player, output, acted)
    astray = number_out_of_bounds(telemetry)
    if astray and command.valid:
        command = invalid_command(command, estimate, astray, known=True)
    played = replace(
        state,
        seq=estimate.seq,
        playing=command.valid and not player.ended,
        player=player,
        memory=after,
        pending=later if command.valid else (),
        watches=watches,
    )
    if not command.valid:
        played = replace(played, silenced=command.fault, found=command.fault)
    return played, (command,) if astray else (command, telemetry)


def _limited(limits_active: int) -> int:
    """As ``winds_up`` takes it: 1 where the voltage cannot rise, -1 where it cannot fall."""
    if limits_active & RAISING:
        return 1
    return -1 if limits_active & LOWERING else 0


def handle(
    config: ControllerConfig, state: State, request: Message, now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Load a program, begin an epoch with it, or note an action."""
    if isinstance(request, Load):
        if not request.program.segments:
            raise RefusedError("the program has no segments")
        if why := config.law_objection(request.program):
            raise RefusedError(why)
        return replace(state, loaded=request.program), Ack(state.seq), ()
    if isinstance(request, Arm):
        if state.loaded is None:
            raise RefusedError("the controller has no program: load one first")
        fresh = State(
            state.arm.armed(config.response),
            epoch=request.epoch,
            owner=request.owner,
            loaded=state.loaded,
            program=state.loaded,
            laws=config.laws(state.loaded),
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
        raise RefusedError(f"nothing plays: {request.action} has nothing to act on")
    if why := action_objection(state.pending, state.player, request.action):
        raise RefusedError(why)
    if request.at_seq is not None and request.at_seq <= state.seq:
        raise RefusedError(f"seq {request.at_seq} is past, the controller is at {state.seq}")
    seq = state.seq + 1 if request.at_seq is None else request.at_seq
    return replace(state, pending=(*state.pending, request)), Ack(seq), ()


SERVICE: Service[RigFile, ControllerConfig, State, Inputs] = Service(
    name="controller",
    summary="plays a program of segments: references, a control law, guards",
    inputs=(Input(ESTIMATE, "trigger"),),
    outputs=(COMMAND, TELEMETRY),
    requests=(
        LOAD,
        ARM["controller"],
        ACTION,
        LEASE,
        STATUS["controller"],
        TIMING_OF["controller"],
    ),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    handle=handle,
    state_snapshot=("arm",),
)
