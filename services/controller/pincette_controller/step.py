"""The controller as a service: an estimate in, a command and the controller's own view out."""

from dataclasses import dataclass, replace
from typing import NamedTuple

from pincette.config import RigFile
from pincette.control.laws import law as control_law
from pincette.control.laws.law import Law, LawState
from pincette.control.laws.sliding import LawOutput
from pincette.control.planning.program import Program
from pincette.messages import (
    SLEW_DOWN,
    SLEW_UP,
    VOLTAGE_MAX,
    VOLTAGE_MIN,
    Act,
    Arm,
    Command,
    Done,
    Estimate,
    Load,
    Message,
    Telemetry,
)
from pincette.service import ForInstrument, Input, RefusedError, Service
from pincette.topics import ACT, ARM, COMMAND, ESTIMATE, LOAD, STATUS, TELEMETRY
from pincette_controller.config import ControllerConfig, configure
from pincette_controller.player import advance, begin
from pincette_controller.playing import Player
from pincette_controller.wishes import ACTIONS, act, objection, told

RAISING, LOWERING = VOLTAGE_MAX | SLEW_UP, VOLTAGE_MIN | SLEW_DOWN
"""Bits of ``limits_active`` that keep the voltage from rising, and from falling."""


class Inputs(NamedTuple):
    """The estimate of the newest sample."""

    estimate: Estimate | None


@dataclass(frozen=True, slots=True)
class State:
    """The program, where it stands, and the law's memory."""

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
    wishes: tuple[Act, ...] = ()
    refused: int = 0
    detail: str = ""


def start(_config: ControllerConfig) -> State:
    """Nothing is loaded."""
    return State()


def step(
    config: ControllerConfig, state: State, inputs: Inputs, _now: float
) -> tuple[State, tuple[Message | ForInstrument, ...]]:
    """Answer one estimate with one command; without a program, or blind, with an invalid one."""
    estimate = inputs.estimate
    if estimate is None:
        return state, ()
    if estimate.epoch != state.epoch:
        return replace(state, refused=state.refused + 1), ()
    state = replace(state, seq=estimate.seq)
    if estimate.tripped and state.playing:
        state = replace(state, playing=False, wishes=(), detail="the actuator has tripped")
    if not state.playing or not estimate.valid or state.program is None:
        return state, (_no_command(state, estimate),)
    return _play(config, state, state.program, estimate)


def _play(
    config: ControllerConfig, state: State, program: Program, estimate: Estimate
) -> tuple[State, tuple[Message | ForInstrument, ...]]:
    before = state.player or begin(program, estimate.x_um, estimate.applied_V)
    memory = state.memory or control_law.start(
        state.laws[before.segment.law],
        x_um=estimate.x_um,
        x_r_um=estimate.x_um,
        force_mN=0.0,
        applied_V=estimate.applied_V,
    )
    player, later, acted = act(program, before, state.wishes, state.seq, estimate.x_um)
    player = advance(program, player, estimate, config.period_s)
    state = replace(state, wishes=later)
    law = state.laws[player.segment.law]
    force_mN = estimate.force_mN if player.pressing else 0.0
    force_r_mN = player.force_r_mN if player.pressing else 0.0
    if player.segment.open_loop:
        pressed_mN = estimate.force_mN if player.held else 0.0
        player = replace(player, x_r_um=estimate.x_um, speed_um_per_s=0.0, force_r_mN=pressed_mN)
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
    )
    telemetry = _telemetry(state, before, memory, player, output, told(acted, before, player))
    playing = not player.ended
    return replace(state, player=player, memory=after, playing=playing), (command, telemetry)


def _limited(limits_active: int) -> int:
    """As ``winds_up`` takes it."""
    if limits_active & RAISING:
        return 1
    return -1 if limits_active & LOWERING else 0


def _no_command(state: State, estimate: Estimate) -> Command:
    return Command(
        epoch=state.epoch,
        seq=estimate.seq,
        owner=state.owner,
        voltage_V=estimate.applied_V,
        part_held=False,
        zero=False,
        final=False,
        valid=False,
        fault=estimate.fault,
    )


def _telemetry(
    state: State,
    before: Player,
    memory: LawState,
    player: Player,
    output: LawOutput,
    acted: str,
) -> Telemetry:
    """How sample k looks: its references are those that the tick before set for it."""
    return Telemetry(
        epoch=state.epoch,
        seq=state.seq,
        playing=not player.ended,
        phase=player.segment.phase,
        segment=player.index,
        segment_tick=player.ticks,
        x_r_um=before.x_r_um,
        x_d_um=memory.x_d_um,
        force_r_mN=before.force_r_mN,
        sliding_um=output.sliding_um,
        band_um=output.band_um,
        perturbation_mN=output.perturbation_mN,
        perturbation_error_mN=output.perturbation_error_mN,
        residual_um=output.residual_um,
        outcome=player.outcome,
        contact_x_um=player.contact_x_um,
        contact_stiffness_mN_per_um=player.K_e_mN_per_um,
        held=player.held,
        acted=acted,
        paused=player.paused,
    )


def answer(
    config: ControllerConfig, state: State, request: Message, _now: float
) -> tuple[State, Message, tuple[Message, ...]]:
    """Load a program, begin an epoch with it, or note an action."""
    if isinstance(request, Load):
        if not request.program.segments:
            raise RefusedError("the program has no segments")
        _check_laws(config, request.program)
        return replace(state, loaded=request.program), Done(state.seq), ()
    if isinstance(request, Arm):
        if state.loaded is None:
            raise RefusedError("the controller has no program: load one first")
        fresh = State(
            epoch=request.epoch,
            owner=request.owner,
            loaded=state.loaded,
            program=state.loaded,
            laws=config.laws(state.loaded),
            playing=True,
            refused=state.refused,
        )
        return fresh, Done(0), ()
    if isinstance(request, Act):
        return _note(state, request)
    raise RefusedError(f"the controller does not answer {type(request).__name__}")


def _check_laws(config: ControllerConfig, program: Program) -> None:
    try:
        laws = config.laws(program)
    except ValueError as error:
        raise RefusedError(f"a law of the program: {error}") from error
    for segment in program.segments:
        if not 0 <= segment.law < len(laws):
            raise RefusedError(f"{segment.phase} names law {segment.law}, there are {len(laws)}")


def _note(state: State, request: Act) -> tuple[State, Message, tuple[Message, ...]]:
    if not state.playing and request.action in ACTIONS:
        raise RefusedError(f"nothing plays: {request.action} has nothing to act on")
    why = objection(state.wishes, state.player, request.action)
    if why:
        raise RefusedError(why)
    if request.at_seq is not None and request.at_seq <= state.seq:
        raise RefusedError(f"seq {request.at_seq} is past, the controller is at {state.seq}")
    seq = state.seq + 1 if request.at_seq is None else request.at_seq
    return replace(state, wishes=(*state.wishes, request)), Done(seq), ()


SERVICE: Service[RigFile, ControllerConfig, State, Inputs] = Service(
    name="controller",
    summary="plays a program of segments: references, a law (PBSMIC or DSMIFC), guards",
    inputs=(Input(ESTIMATE, "trigger"),),
    outputs=(COMMAND, TELEMETRY),
    questions=(LOAD, ARM["controller"], ACT, STATUS["controller"]),
    inputs_type=Inputs,
    configure=configure,
    start=start,
    step=step,
    answer=answer,
)
