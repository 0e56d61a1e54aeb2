"""The controller as a service: an estimate in, a command and the controller's own view out."""

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.control.planning.program import Program
from pincette.control.safety.voltage import limited
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
from pincette_controller.driving import arm_view, at_measured, drive
from pincette_controller.learning import begin_learning, correct, learn
from pincette_controller.outputs import (
    check_command,
    command_of,
    known_force_mN,
    no_command,
    telemetry_of,
)
from pincette_controller.pair_step import followed_second, play_pair
from pincette_controller.player import advance, begin, foresee
from pincette_controller.player_state import Player
from pincette_controller.requests import handle
from pincette_controller.state import Inputs, SecondState, State, ended_tick

TRIPPED = Fault(FaultCode.ACTUATOR_TRIPPED)


def start(config: ControllerConfig) -> State:
    """Nothing is loaded."""
    second = config.second
    other = None if second is None else SecondState(ArmMemory(second.response, second.response))
    return State(ArmMemory(config.response, config.response), second=other)


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
    if estimate.epoch != state.epoch or len(estimate.arms) != (1 if config.second is None else 2):
        return replace(state, refused=state.refused + 1), ()
    state = replace(state, arm=state.arm.follow(estimate, 0, config.period_s))
    if state.second is not None:
        state = replace(state, second=followed_second(state.second, estimate, config.period_s))
    if state.playing and estimate.valid and not estimate.tripped and state.program is not None:
        if config.second is not None and state.second is not None:
            return play_pair(config, config.second, state, state.second, estimate)
        return _play(config, state, state.program, estimate)
    state = replace(state, seq=estimate.seq)
    if estimate.tripped and state.playing:
        state = replace(state, playing=False, pending=(), found=TRIPPED)
    return state, (_silent(state, estimate),)


def ahead(config: ControllerConfig, state: State, told: Message) -> State:
    """Lead each arm's memory by the voltage commanded, as the actuator will mostly put it out, and
    the references to the next sample."""
    if not isinstance(told, Command) or not told.valid or told.epoch != state.epoch:
        return state
    arm = _led_ahead(config, state.arm, told.arms[0].voltage_V, told.seq)
    second, player = state.second, state.player
    if second is None:
        coming = None if player is None else foresee(player)
        return replace(state, arm=arm, foreseen=coming)
    if config.second is not None:
        other = _led_ahead(config.second, second.arm, told.arms[1].voltage_V, told.seq)
        second = replace(second, arm=other)
    return replace(state, arm=arm, second=second)


def _led_ahead(config: ControllerConfig, arm: ArmMemory, voltage_V: float, seq: int) -> ArmMemory:
    """Expect what the actuator makes of a voltage in time: its range, its slew, its step."""
    put_out_V, _ = limited(config.voltage, arm.response.voltage_V, voltage_V)
    return arm.expecting(put_out_V, seq + 1, config.period_s)


def _silent(state: State, estimate: Estimate) -> Command:
    return no_command(estimate, state.epoch, state.owner, state.silenced, state.player)


def _play(
    config: ControllerConfig, state: State, program: Program, estimate: Estimate
) -> tuple[State, tuple[Message | DeviceCommand, ...]]:
    """Play one tick: actions, guards and references, then the law, then the checked command."""
    measured = estimate.arms[0]
    before = state.player or begin(program, measured, config.period_s)
    known = state.learning or begin_learning(program)
    player, later, effects = act(program, before, state.pending, estimate.seq, measured.x_um)
    player = advance(program, player, measured, config.period_s, state.foreseen, config.steps)
    learning = correct(learn(known, before, measured, config.period_s), player, config.period_s)
    if player.segment.open_loop:
        player = at_measured(player, measured.x_um, measured.force_mN)
    arms = (arm_view(measured, state.arm),)
    law_state, wanted = drive(
        state.laws, state.law_state, before, player, arms, learning.correction_um
    )
    voltage_V = _planned_V(program, player, measured, wanted.voltages_V[0])
    steered = state.law_state is not None and not player.segment.open_loop
    x_d_um = wanted.x_d_um if steered and not player.ended else None
    asked = ArmCommand(voltage_V, known_force_mN(estimate, 0, player), x_d_um)
    command = command_of(program, player, estimate, state.owner, (asked,))
    watches, command = check_command((config,), (state.watches,), command, estimate)
    acted = acted_in_tick(effects, before, player)
    references = (ArmTelemetry(before.ref.x_um, wanted.x_d_um),)
    view = telemetry_of(estimate, before, player, wanted, references, acted, known.correction_um)
    return ended_tick(
        state,
        player,
        later,
        command,
        view,
        estimate,
        law_state=law_state,
        learning=learning,
        watches=watches[0],
    )


def _planned_V(program: Program, player: Player, measured: ArmEstimate, wanted_V: float) -> float:
    """Return the voltage to command: frozen, or within the range that the plan has stated."""
    if player.ended:
        return measured.applied_V
    voltage_V = wanted_V if player.slip.suspect is None else measured.applied_V
    planned = program.planned_range
    if planned is None:
        return voltage_V
    low_V, high_V = planned.voltage.from_voltage(measured.applied_V)
    return min(max(voltage_V, low_V), high_V)


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
    ahead=ahead,
    state_snapshot=("arm", "second.arm"),
)
