"""Outputs of the controller: a command within the hard limits, or none, and its telemetry.

The guards end a program gently. If that is not enough, or the law has diverged, the controller
sends no more valid commands. It checks each command by the actuator's own rules. A command that
violates them is sent as invalid, with its fault and the known values of the sample, from which the
actuator finds the same fault and trips. Without these values the actuator's age limit would trip
it, since no valid command follows.
"""

from operator import attrgetter

from msgspec.structs import replace

from pincette.control.planning.program import Program
from pincette.control.planning.segments import PlayedSweep
from pincette.control.safety.admission import nonsense
from pincette.control.safety.monitors import Watches, finding, watch_command, watch_position
from pincette.core.codec.refusals import largest_floats
from pincette.core.faults import Acted, Fault, FaultCode, fault
from pincette.core.messages import Command, Estimate, Telemetry
from pincette.core.messages.arms import ARM_PREFIXES, ArmCommand, ArmTelemetry
from pincette_controller.config import ArmConfig
from pincette_controller.control_laws import Wanted
from pincette_controller.force_bounds import sure_force_mN
from pincette_controller.player_state import Player
from pincette_controller.slipping import undecided_um

NUMBERS, ARM_NUMBERS = largest_floats(Telemetry), largest_floats(ArmTelemetry)
"""Numbers of telemetry, and of each arm in it, with the largest magnitude that a decoder
accepts."""
NUMBERS_OF = attrgetter(*[name for name, _ in NUMBERS])
ARM_NUMBERS_OF = attrgetter(*[name for name, _ in ARM_NUMBERS])


def known_force_mN(estimate: Estimate, arm: int, player: Player | None) -> float | None:
    """Return the force that is compared with an arm's hard limit, computed as the guards do.

    The result is None within a sweep.
    """
    if not estimate.valid or (player is not None and player.segment.hides_force):
        return None
    return sure_force_mN(estimate.arms[arm])


def no_command(
    estimate: Estimate, epoch: int, owner: int, silenced: Fault | None, player: Player | None
) -> Command:
    """Return an invalid command with the forces, by which the actuator monitors a part held at
    constant voltage."""
    arms: list[ArmCommand] = []
    for arm, seen in enumerate(estimate.arms):
        arms.append(ArmCommand(seen.applied_V, force_mN=known_force_mN(estimate, arm, player)))
    return Command(
        epoch=epoch,
        seq=estimate.seq,
        owner=owner,
        arms=tuple(arms),
        part_held=False,
        zero=False,
        final=False,
        valid=False,
        fault=estimate.fault or silenced,
    )


def command_of(
    program: Program,
    player: Player,
    estimate: Estimate,
    owner: int,
    arms: tuple[ArmCommand, ...],
) -> Command:
    """Return a command with the state of the program, before it is checked."""
    segment = player.segment
    return Command(
        epoch=estimate.epoch,
        seq=estimate.seq,
        owner=owner,
        arms=arms,
        part_held=player.held,
        zero=player.zero,
        final=player.ended,
        valid=True,
        sweep=segment.sweep if isinstance(segment, PlayedSweep) and not player.ended else None,
        segment=player.index if 0 <= player.index < len(program.segments) else None,
        segment_tick=player.ticks,
        step_um=undecided_um(player),
    )


def telemetry_of(
    estimate: Estimate,
    before: Player,
    player: Player,
    wanted: Wanted,
    arms: tuple[ArmTelemetry, ...],
    place_um: float,
    acted: tuple[Acted, ...],
    correction_um: float,
) -> Telemetry:
    """Return the telemetry of sample k, whose references were set in the previous tick."""
    seen, line, touch = player.slip.confirmed, player.entry.line, player.touch
    output, alone = wanted.output, player.felt is None
    return Telemetry(
        epoch=estimate.epoch,
        seq=estimate.seq,
        playing=not player.ended,
        phase=player.segment.phase,
        segment=player.index,
        segment_tick=player.ticks,
        arms=arms,
        force_r_mN=before.ref.force_mN,
        sliding_um=output.sliding_um,
        band_um=output.band_um,
        perturbation_mN=output.perturbation_mN,
        perturbation_error_mN=output.perturbation_error_mN,
        residual_um=output.residual_um,
        outcome=player.outcome,
        contact_x_um=player.entry.held_at_um if line is None else line.x_e_um,
        contact_stiffness_mN_per_um=None if line is None else line.K_e_mN_per_um,
        held=player.held,
        acted=acted,
        paused=player.pause.active,
        touch_x_um=touch and touch.x_um,
        touch_mN=touch and touch.force_mN,
        place_um=None if alone else place_um,
        place_r_um=None if alone else before.ref.x_um,
        correction_um=correction_um,
        slips=player.slip.slips,
        step_um=seen and seen.step_um,
        step_x_um=seen and seen.step.before_x_um,
        step_mN=seen and seen.force_mN,
        step_after_mN=seen and seen.after_mN,
    )


def number_out_of_bounds(telemetry: Telemetry) -> Fault | None:
    """Return the fault of a law with a number that a decoder would reject; None if there is
    none."""
    for arm, of_arm in zip(ARM_PREFIXES, telemetry.arms, strict=False):
        for (name, most), number in zip(ARM_NUMBERS, ARM_NUMBERS_OF(of_arm), strict=True):
            if not -most <= number <= most:
                return fault(FaultCode.LAW_NUMBER, **{f"{arm}{name}": number})
    for (name, most), number in zip(NUMBERS, NUMBERS_OF(telemetry), strict=True):
        if number is not None and not -most <= number <= most:
            return fault(FaultCode.LAW_NUMBER, **{name: number})
    return None


def check_command(
    configs: tuple[ArmConfig, ...],
    watches: tuple[Watches, ...],
    command: Command,
    estimate: Estimate,
) -> tuple[tuple[Watches, ...], Command]:
    """Return a command limited to each arm's own limits, or an invalid one.

    An invalid command keeps the applied voltages.
    """
    watched: list[Watches] = []
    refusal, known = None, True
    arms = zip(configs, watches, command.arms, estimate.arms, strict=True)
    for config, before, asked, measured in arms:
        if why := nonsense(config.voltage, asked.voltage_V, asked.force_mN, asked.x_d_um):
            refusal, known = refusal or why, False
            watched.append(before)
            continue
        after = watch_command(
            config.monitors,
            watch_position(config.monitors, before, measured.x_um),
            seq=command.seq,
            x_um=measured.x_um,
            x_d_um=asked.x_d_um,
            force_mN=asked.force_mN,
        )
        found = finding(config.monitors, after)
        if found is not None:
            refusal = refusal or found.fault
        watched.append(after)
    if refusal is not None:
        command = invalid_command(command, estimate, refusal, known=known)
    return tuple(watched), command


def invalid_command(command: Command, estimate: Estimate, why: Fault, *, known: bool) -> Command:
    """Return a command that keeps the voltages.

    ``known`` states whether force and x_d are finite.
    """
    arms: list[ArmCommand] = []
    for asked, measured in zip(command.arms, estimate.arms, strict=True):
        kept = ArmCommand(measured.applied_V)
        if known:
            kept = ArmCommand(measured.applied_V, asked.force_mN, asked.x_d_um)
        arms.append(kept)
    return replace(
        command, arms=tuple(arms), zero=False, final=False, valid=False, fault=why, sweep=None
    )
