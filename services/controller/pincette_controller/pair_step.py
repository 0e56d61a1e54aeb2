"""A tick of two arms: an estimate of both in, one command for both out.

It does for two arms what ``step`` does for one.
"""

from msgspec.structs import replace

from pincette.control.laws.two_arms import Pair
from pincette.core.faults import Acted
from pincette.core.messages import Command, Estimate, Telemetry
from pincette.core.messages.arms import ArmCommand, ArmTelemetry
from pincette_controller.actions import act, acted_in_tick
from pincette_controller.config import ControllerConfig
from pincette_controller.control_laws import Wanted
from pincette_controller.driving import arm_view, at_measured, drive
from pincette_controller.outputs import (
    check_command,
    command_of,
    known_force_mN,
    telemetry_of,
)
from pincette_controller.pair_player import advance_pair, begin_pair
from pincette_controller.pair_stand import Seen, seen
from pincette_controller.player_state import Player
from pincette_controller.state import SecondState, State, ended_tick


def followed_second(second: SecondState, estimate: Estimate, period_s: float) -> SecondState:
    """Lead the second arm's memory by the voltage applied to it."""
    return replace(second, arm=second.arm.follow(estimate, 1, period_s))


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
    before = state.player or begin_pair(program, now, config.period_s)
    player, later, effects = act(program, before, state.pending, estimate.seq, now.place_um)
    player = advance_pair(program, player, now, config.period_s)
    if player.segment.open_loop:
        force_mN = 0.5 * sum(now.forces_mN)
        player = at_measured(player, now.place_um, force_mN, now.opening_um)
    one, two = estimate.arms
    arms = arm_view(one, state.arm), arm_view(two, second.arm)
    law_state, wanted = drive(state.laws, state.law_state, before, player, arms)
    voltages_V = now.applied_V if player.ended else wanted.voltages_V
    aims_um = None if player.ended or state.law_state is None else _aims_um(before, now)
    asked: list[ArmCommand] = []
    for arm, voltage_V in enumerate(voltages_V):
        x_d_um = None if aims_um is None else aims_um[arm]
        asked.append(ArmCommand(voltage_V, known_force_mN(estimate, arm, player), x_d_um))
    command = command_of(program, player, estimate, state.owner, tuple(asked))
    watches, command = check_command(
        (config, second_config), (state.watches, second.watches), command, estimate
    )
    acted = acted_in_tick(effects, before, player)
    telemetry = _telemetry(estimate, before, player, wanted, now, acted)
    return ended_tick(
        state,
        player,
        later,
        command,
        telemetry,
        estimate,
        law_state=law_state,
        second=replace(second, watches=watches[1]),
        watches=watches[0],
    )


def _aims_um(before: Player, now: Seen) -> Pair | None:
    """Where the tips were to be at this sample; of a pressed part as open as they are."""
    if before.segment.open_loop:
        return None
    opening_um = now.opening_um if before.segment.presses else before.ref.opening_um
    return 0.5 * opening_um + before.ref.x_um, 0.5 * opening_um - before.ref.x_um


def _telemetry(
    estimate: Estimate,
    before: Player,
    player: Player,
    wanted: Wanted,
    now: Seen,
    acted: tuple[Acted, ...],
) -> Telemetry:
    """Return the telemetry of sample k: its references are those that the tick before set."""
    first_um, second_um = _aims_um(before, now) or now.tips_um
    arms = ArmTelemetry(first_um, first_um), ArmTelemetry(second_um, second_um)
    return replace(
        telemetry_of(estimate, before, player, wanted, arms, acted, 0.0),
        contact_x_um=player.entry.held_at_um,
        place_um=now.place_um,
        place_r_um=before.ref.x_um,
    )
