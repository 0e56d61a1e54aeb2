"""The controller as a service: an estimate in, a command and the controller's own view out."""

from msgspec import UNSET
from msgspec.structs import replace

from pincette.config import RigFile
from pincette.control.laws import law as control_law
from pincette.control.laws.planned_motion import RESTING
from pincette.control.planning.program import Program
from pincette.control.safety.voltage import (
    SLEW_DOWN,
    SLEW_UP,
    VOLTAGE_MAX,
    VOLTAGE_MIN,
    limited,
)
from pincette.core.faults import Fault, FaultCode, Outcome
from pincette.core.messages import (
    Command,
    Estimate,
    Message,
    RequestLog,
)
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
from pincette_controller.learning import begin_learning, correct, learn
from pincette_controller.outputs import (
    check_command,
    invalid_command,
    known_force_mN,
    no_command,
    number_out_of_bounds,
    telemetry_of,
)
from pincette_controller.pair_step import followed_second, play_pair
from pincette_controller.player import advance, begin, foresee
from pincette_controller.preview import planned_motion
from pincette_controller.requests import handle
from pincette_controller.state import Inputs, SecondState, State

RAISING, LOWERING = VOLTAGE_MAX | SLEW_UP, VOLTAGE_MIN | SLEW_DOWN
"""Bits of ``limits_active`` that keep the voltage from rising, and from falling."""
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
    if estimate.epoch != state.epoch:
        return replace(state, refused=state.refused + 1), ()
    state = replace(state, arm=state.arm.follow(estimate, config.period_s))
    if state.second is not None and estimate.second is not UNSET:
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
    arm = _led_ahead(config, state.arm, told.voltage_V, told.seq)
    second, player = state.second, state.player
    if second is None:
        coming = None if player is None else foresee(player, config.period_s)
        return replace(state, arm=arm, foreseen=coming)
    if config.second is not None and told.second is not UNSET:
        other = _led_ahead(config.second, second.arm, told.second.voltage_V, told.seq)
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
    before = state.player or begin(program, estimate.x_um, estimate.applied_V, estimate.force_mN)
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
    player = advance(program, player, estimate, config.period_s, state.foreseen, config.steps)
    law = state.laws[player.segment.law]
    learning = state.learning or begin_learning(program)
    told_um = learning.correction_um
    learning = learn(learning, before, estimate, config.period_s)
    learning = correct(learning, player, config.period_s)
    open_loop, pressing = player.segment.open_loop, player.pressing
    force_mN = estimate.force_mN if pressing else 0.0
    force_r_mN = player.force_r_mN if pressing else 0.0
    if open_loop:
        pressed_mN = estimate.force_mN if player.held else 0.0
        player = replace(player, x_r_um=estimate.x_um, speed_um_per_s=0.0, force_r_mN=pressed_mN)
    steered = state.memory is not None and not open_loop
    anew = player.bump or open_loop or pressing != before.pressing
    if anew or player.segment.law != before.segment.law:
        # Another law alone: the references go on, and the newest sample belongs to those before.
        known = player if anew else before
        x_r_um, r_mN = known.x_r_um, known.force_r_mN
        if player.bump and player.segment.follows:
            # References that begin in motion: those of the newest sample, where it was touched.
            x_r_um, r_mN = player.from_x_um, player.from_force_mN
        memory = control_law.rebase(
            law,
            memory,
            x_um=estimate.x_um,
            x_r_um=x_r_um,
            force_mN=force_mN,
            force_r_mN=r_mN if pressing else 0.0,
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
        x_r_um=player.x_r_um + learning.correction_um,
        force_r_mN=force_r_mN,
        limited=_limited(estimate.limits_active),
        memory=arm_memory,
        plan=planned_motion(player, config.period_s) if law.definition.previews else RESTING,
    )
    voltage_V = player.voltage_V if open_loop else output.voltage_V
    if player.suspect is not None:
        voltage_V = estimate.applied_V
    planned = program.planned_range
    if planned is not None:
        low_V, high_V = planned.voltage.from_voltage(estimate.applied_V)
        voltage_V = min(max(voltage_V, low_V), high_V)
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
        force_mN=known_force_mN(estimate, player),
        x_d_um=None if player.ended or not steered else memory.x_d_um,
        segment=player.index if 0 <= player.index < len(program.segments) else None,
        segment_tick=player.ticks,
    )
    watches, command = check_command(config, state.watches, command, estimate)
    acted = acted_in_tick(effects, before, player)
    telemetry = telemetry_of(estimate, before, memory, player, output, acted, told_um)
    astray = number_out_of_bounds(telemetry)
    if astray and command.valid:
        command = invalid_command(command, estimate, astray, known=True)
    played = replace(
        state,
        seq=estimate.seq,
        playing=command.valid and not player.ended,
        player=player,
        memory=after,
        learning=learning,
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
