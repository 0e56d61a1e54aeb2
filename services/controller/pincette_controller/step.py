"""The controller as a service: an estimate in, a command and its telemetry out."""

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.control.planning.program import PlannedRange, Program
from pincette.control.safety.monitors import UNSEEN
from pincette.core.faults import Fault, FaultCode, Outcome
from pincette.core.messages import (
    Command,
    Estimate,
    Message,
    RequestLog,
)
from pincette.core.messages.arms import ArmCommand, ArmEstimate, ArmTelemetry
from pincette.core.service import DeviceCommand, Input, Service
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
    act,
    acted_in_tick,
    lease_end,
)
from pincette_controller.arm_memory import ArmMemory
from pincette_controller.config import ControllerConfig, configure
from pincette_controller.control_laws import ArmView, Wanted
from pincette_controller.driving import arm_view, at_measured, drive
from pincette_controller.felt import place_um
from pincette_controller.learning import begin_learning, correct, learn
from pincette_controller.outputs import (
    check_command,
    command_of,
    known_force_mN,
    no_command,
    telemetry_of,
)
from pincette_controller.player import advance, begin
from pincette_controller.player_state import Player
from pincette_controller.requests import handle
from pincette_controller.state import Inputs, State, ended_tick

TRIPPED = Fault(FaultCode.ACTUATOR_TRIPPED)


def start(config: ControllerConfig) -> State:
    """Return the state before any program is loaded."""
    memories = tuple(ArmMemory(arm.response, arm.response) for arm in config.arms)
    return State(memories, (UNSEEN,) * len(memories))


def step(
    config: ControllerConfig, state: State, inputs: Inputs, now: float
) -> tuple[State, tuple[Message | DeviceCommand, ...]]:
    """Reply to an estimate with a command; an ended lease stops the program at the next
    estimate."""
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
    if estimate.epoch != state.epoch or len(estimate.arms) != len(config.arms):
        return replace(state, refused=state.refused + 1), ()
    memories: tuple[ArmMemory, ...] = ()
    for memory, arm in zip(state.memories, estimate.arms, strict=True):
        memories += (memory.updated(estimate, arm.applied_V, config.period_s),)
    state = replace(state, memories=memories)
    if state.playing and estimate.valid and not estimate.tripped and state.program is not None:
        return _play(config, state, state.program, estimate)
    state = replace(state, seq=estimate.seq)
    if estimate.tripped and state.playing:
        state = replace(state, playing=False, pending=(), found=TRIPPED)
    return state, (_silent(state, estimate),)


def _silent(state: State, estimate: Estimate) -> Command:
    return no_command(estimate, state.epoch, state.owner, state.silenced, state.player)


def _play(
    config: ControllerConfig, state: State, program: Program, estimate: Estimate
) -> tuple[State, tuple[Message | DeviceCommand, ...]]:
    """Play one tick: actions, guards and references, then the law, then the checked command."""
    arms, period_s = estimate.arms, config.period_s
    x_um = arms[0].x_um if len(arms) == 1 else place_um(arms)
    before = state.player or begin(program, arms, period_s)
    known = state.learning or begin_learning(program, len(arms))
    player, later, effects = act(program, before, state.pending, estimate.seq, x_um)
    player = advance(program, player, arms, period_s, config.steps)
    learning = correct(learn(known, before, arms[0], period_s), player, period_s)
    if player.segment.open_loop:
        player = at_measured(player, arms, x_um)
    views: tuple[ArmView, ...] = ()
    for measured, memory in zip(arms, state.memories, strict=True):
        views += (arm_view(measured, memory),)
    law_state, wanted = drive(
        state.laws, state.law_state, before, player, views, learning.correction_um
    )
    asked, references = _asked(program, state, before, player, estimate, wanted)
    command = command_of(program, player, estimate, state.owner, asked)
    watches, command = check_command(config.arms, state.watches, command, estimate)
    acted = acted_in_tick(effects, before, player)
    view = telemetry_of(
        estimate, before, player, wanted, references, x_um, acted, known.correction_um
    )
    return ended_tick(
        state,
        player,
        later,
        command,
        view,
        estimate,
        law_state=law_state,
        learning=learning,
        watches=watches,
    )


def _asked(
    program: Program,
    state: State,
    before: Player,
    player: Player,
    estimate: Estimate,
    wanted: Wanted,
) -> tuple[tuple[ArmCommand, ...], tuple[ArmTelemetry, ...]]:
    """Return the command of each arm, and its references at the newest sample."""
    alone = player.felt is None
    # With two arms, only the actuator enforces the range that the plan has stated.
    planned = program.planned_range if alone else None
    stated = state.law_state is not None and not player.ended
    stated = stated and not (alone and player.segment.open_loop)
    asked: tuple[ArmCommand, ...] = ()
    references: tuple[ArmTelemetry, ...] = ()
    aims_um = _aims_um(before, player, wanted)
    for arm, measured in enumerate(estimate.arms):
        aim_um = aims_um[arm]
        voltage_V = _planned_V(planned, player, measured, wanted.voltages_V[arm])
        force_mN = known_force_mN(estimate, arm, player)
        asked += (ArmCommand(voltage_V, force_mN, aim_um if stated else None),)
        references += (ArmTelemetry(before.ref.x_um if alone else aim_um, aim_um),)
    return asked, references


def _aims_um(before: Player, player: Player, wanted: Wanted) -> tuple[float, ...]:
    """Return the desired position of each tip at the newest sample, in µm.

    With one arm, the law returns it. With two arms it follows from the position reference and the
    opening, which is the measured one while a part is pressed. Without a law the measured positions
    of both tips are returned.
    """
    felt, ref = player.felt, before.ref
    if felt is None:
        return (wanted.x_d_um,)
    if before.segment.open_loop:
        return felt.tips_um
    half_um = 0.5 * (sum(felt.tips_um) if before.segment.presses else ref.opening_um)
    return half_um + ref.x_um, half_um - ref.x_um


def _planned_V(
    planned: PlannedRange | None, player: Player, measured: ArmEstimate, wanted_V: float
) -> float:
    """Return the voltage to command, in V: frozen, or within the range stated by the plan."""
    if player.ended or player.slip.suspect is not None:
        return measured.applied_V
    if planned is None:
        return wanted_V
    low_V, high_V = planned.voltages[0].from_voltage(measured.applied_V)
    return min(max(wanted_V, low_V), high_V)


SERVICE: Service[RigFile, ControllerConfig, State, Inputs] = Service(
    name="controller",
    summary="plays a motion program of segments: references, a control law, guards",
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
    state_snapshot=("memories",),
)
