"""A tick of two arms: an estimate of both in, one command for both out.

As ``step`` for one arm, with the law of ``two_arms`` in the place of a law of one.
"""

from msgspec import UNSET
from msgspec.structs import replace

from pincette.control.laws import two_arms
from pincette.control.laws.two_arms import Pair, TwoArmOutput
from pincette.control.response.hysteresis import displacement_um
from pincette.control.response.identified_response import IdentifiedResponse
from pincette.control.response.inverse import voltage_for
from pincette.control.safety.monitors import Watches
from pincette.core.faults import Acted
from pincette.core.messages import Command, Estimate, Telemetry
from pincette.core.messages.second import SecondCommand, SecondTelemetry
from pincette_controller.actions import act, acted_in_tick
from pincette_controller.arm_memory import ArmMemory
from pincette_controller.config import ControllerConfig
from pincette_controller.outputs import (
    check_command,
    invalid_command,
    known_force_mN,
    number_out_of_bounds,
    second_view,
)
from pincette_controller.pair_player import advance_pair, begin_pair
from pincette_controller.pair_references import references
from pincette_controller.pair_stand import PairStand, Seen, seen
from pincette_controller.player_state import Player
from pincette_controller.state import SecondState, State


def followed_second(second: SecondState, estimate: Estimate, period_s: float) -> SecondState:
    """Lead the second arm's memory by the voltage applied to it."""
    return replace(second, arm=second.arm.follow(second_view(estimate), period_s))


def play_pair(
    config: ControllerConfig,
    second_config: ControllerConfig,
    state: State,
    second: SecondState,
    estimate: Estimate,
) -> tuple[State, tuple[Command] | tuple[Command, Telemetry]]:
    """Answer an estimate of both arms while a program plays; raises ValueError without one."""
    program = state.program
    if program is None:
        raise ValueError("no program plays")
    now = seen(estimate)
    before = state.player or begin_pair(program, now)
    player, later, effects = act(program, before, state.pending, estimate.seq, now.place_um)
    player = advance_pair(program, player, now, config.period_s)
    if player.segment.open_loop:
        pressed_mN = 0.5 * sum(now.forces_mN) if player.held else 0.0
        player = _open_loop(player, now, pressed_mN)
    pair, memory, output = player.pair, second.memory, None
    if pair is None:
        raise ValueError("the player has one arm")
    voltages_V = player.voltage_V, pair.second_voltage_V
    if player.segment.open_loop:
        memory = None
    else:
        arms = (config, state.arm), (second_config, second.arm)
        law = second.laws[player.segment.law]
        memory, output = two_arms.step(
            law,
            two_arms.start() if memory is None or player.bump else memory,
            tips_um=now.tips_um,
            free_um=(_free_um(*arms[0]), _free_um(*arms[1])),
            forces_mN=now.forces_mN,
            references=references(player, pair),
        )
        voltages_V = tuple(
            _voltage_V(of, arm, wanted_um)
            for (of, arm), wanted_um in zip(arms, output.free_um, strict=True)
        )
    if player.ended:
        voltages_V = now.applied_V
    aims_um = None if player.ended or second.memory is None else _aims_um(before, now)
    command = Command(
        epoch=state.epoch,
        seq=estimate.seq,
        owner=state.owner,
        voltage_V=voltages_V[0],
        part_held=player.held,
        zero=player.zero,
        final=player.ended,
        valid=True,
        force_mN=known_force_mN(estimate, player),
        x_d_um=None if aims_um is None else aims_um[0],
        segment=player.index if 0 <= player.index < len(program.segments) else None,
        segment_tick=player.ticks,
        second=SecondCommand(
            voltages_V[1],
            force_mN=known_force_mN(second_view(estimate), player),
            x_d_um=None if aims_um is None else aims_um[1],
        ),
    )
    watches, command = _checked(
        config, second_config, (state.watches, second.watches), command, estimate
    )
    acted = acted_in_tick(effects, before, player)
    telemetry = _telemetry(estimate, before, player, output, now, acted)
    astray = number_out_of_bounds(telemetry)
    if astray and command.valid:
        command = invalid_command(command, estimate, astray, known=True)
    played = replace(
        state,
        seq=estimate.seq,
        playing=command.valid and not player.ended,
        player=player,
        second=replace(second, memory=memory, watches=watches[1]),
        pending=later if command.valid else (),
        watches=watches[0],
    )
    if not command.valid:
        played = replace(played, silenced=command.fault, found=command.fault)
    return played, (command,) if astray else (command, telemetry)


def _open_loop(player: Player, now: Seen, pressed_mN: float) -> Player:
    """Where no law leads, the references are where the arms are."""
    pair = None if player.pair is None else replace(player.pair, opening_um=now.opening_um)
    return replace(
        player, x_r_um=now.place_um, speed_um_per_s=0.0, force_r_mN=pressed_mN, pair=pair
    )


def _free_um(config: ControllerConfig, arm: ArmMemory) -> float:
    """H of the newest sample; of a rig without an identified response the line d_p·u."""
    response = arm.response
    if isinstance(response, IdentifiedResponse):
        return displacement_um(response.model, response.memory)
    return config.arm.d / config.arm.k * response.voltage_V


def _voltage_V(config: ControllerConfig, arm: ArmMemory, wanted_um: float) -> float:
    """u = H⁻¹[X], a period ahead."""
    response, d_p = arm.response, config.arm.d / config.arm.k
    if isinstance(response, IdentifiedResponse):
        return voltage_for(
            response.model, response.memory, wanted_um, um_per_V=d_p, period_s=config.period_s
        )
    return wanted_um / d_p


def _aims_um(before: Player, now: Seen) -> Pair | None:
    """Where the tips were to be at this sample; of a pressed part as open as they are."""
    pair: PairStand | None = before.pair
    if pair is None or before.segment.open_loop:
        return None
    opening_um = now.opening_um if before.pressing else pair.opening_um
    return 0.5 * opening_um + before.x_r_um, 0.5 * opening_um - before.x_r_um


def _checked(
    config: ControllerConfig,
    second_config: ControllerConfig,
    watches: tuple[Watches, Watches],
    command: Command,
    estimate: Estimate,
) -> tuple[tuple[Watches, Watches], Command]:
    """The command as it may leave: each arm's part of it within that arm's own limits."""
    first, kept = check_command(config, watches[0], command, estimate)
    of_second = command.second
    if of_second is UNSET:
        return (first, watches[1]), kept
    view = replace(
        command,
        voltage_V=of_second.voltage_V,
        force_mN=of_second.force_mN,
        x_d_um=of_second.x_d_um,
    )
    other, checked = check_command(second_config, watches[1], view, second_view(estimate))
    if kept.valid and not checked.valid and checked.fault is not None:
        kept = invalid_command(command, estimate, checked.fault, known=True)
    return (first, other), kept


def _telemetry(
    estimate: Estimate,
    before: Player,
    player: Player,
    output: TwoArmOutput | None,
    now: Seen,
    acted: tuple[Acted, ...],
) -> Telemetry:
    """Telemetry of sample k: its references are those that the tick before set for it."""
    aims_um = _aims_um(before, now) or now.tips_um
    return Telemetry(
        epoch=estimate.epoch,
        seq=estimate.seq,
        playing=not player.ended,
        phase=player.segment.phase,
        segment=player.index,
        segment_tick=player.ticks,
        x_r_um=aims_um[0],
        x_d_um=aims_um[0],
        force_r_mN=before.force_r_mN,
        sliding_um=0.0,
        band_um=0.0,
        perturbation_mN=0.0,
        perturbation_error_mN=0.0,
        residual_um=0.0 if output is None else output.place_missed_um,
        outcome=player.outcome,
        contact_x_um=player.contact_x_um,
        contact_stiffness_mN_per_um=None,
        held=player.held,
        acted=acted,
        paused=player.paused,
        touch_x_um=player.touch_x_um,
        touch_mN=player.touch_mN,
        second=SecondTelemetry(
            x_um=now.tips_um[1],
            x_r_um=aims_um[1],
            x_d_um=aims_um[1],
            force_mN=now.forces_mN[1],
            voltage_V=now.applied_V[1],
            place_um=now.place_um,
            place_r_um=before.x_r_um,
        ),
    )
