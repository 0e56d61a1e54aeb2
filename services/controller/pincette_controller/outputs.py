"""What the controller sends: a command that keeps the hard limits, or none, and its telemetry.

The guards end a program gently; where what they did is not enough, or the law has gone astray, the
controller commands no more. It checks each command by the actuator's own rules: one that breaks
them is sent as invalid, with its fault and what is known of the sample, by which the actuator finds
the same and trips. Without it the actuator's age limit would act, since no valid command follows.
"""

from operator import attrgetter

from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from pincette.control.planning.program import Program
from pincette.control.planning.segments import PlayedSweep
from pincette.control.safety.admission import nonsense
from pincette.control.safety.monitors import Watches, finding, watch_command, watch_position
from pincette.core.codec.refusals import largest_floats
from pincette.core.faults import Acted, Fault, FaultCode, fault
from pincette.core.messages import Command, Estimate, Telemetry
from pincette.core.messages.second import SecondCommand, SecondTelemetry
from pincette_controller.config import ControllerConfig
from pincette_controller.control_laws import Wanted
from pincette_controller.force_bounds import sure_force_mN
from pincette_controller.player_state import Player

NUMBERS, SECOND_NUMBERS = largest_floats(Telemetry), largest_floats(SecondTelemetry)
"""Numbers of telemetry, and of its second arm, with the largest magnitude that a decoder takes."""
NUMBERS_OF = attrgetter(*[name for name, _ in NUMBERS])
SECOND_NUMBERS_OF = attrgetter(*[name for name, _ in SECOND_NUMBERS])


def known_force_mN(estimate: Estimate, player: Player | None) -> float | None:
    """The force that the hard limit is held against, as the guards take it; None within a sweep."""
    if not estimate.valid or (player is not None and isinstance(player.segment, PlayedSweep)):
        return None
    return sure_force_mN(estimate)


def no_command(
    estimate: Estimate, epoch: int, owner: int, silenced: Fault | None, player: Player | None
) -> Command:
    """An invalid command with the force, by which the actuator watches a frozen part."""
    return Command(
        epoch=epoch,
        seq=estimate.seq,
        owner=owner,
        voltage_V=estimate.applied_V,
        part_held=False,
        zero=False,
        final=False,
        valid=False,
        fault=estimate.fault or silenced,
        force_mN=known_force_mN(estimate, player),
        second=_no_command_of_second(estimate),
    )


def second_view(estimate: Estimate) -> Estimate:
    """The second arm's estimate as if it were the only one."""
    second = estimate.second
    if second is UNSET:
        return estimate
    return replace(
        estimate,
        x_um=second.x_um,
        force_mN=second.force_mN,
        force_uncertainty_mN=second.force_uncertainty_mN,
        zero_age_s=second.zero_age_s,
        applied_V=second.applied_V,
        limits_active=second.limits_active,
        second=UNSET,
    )


def _no_command_of_second(estimate: Estimate) -> SecondCommand | UnsetType:
    if estimate.second is UNSET:
        return UNSET
    view = second_view(estimate)
    return SecondCommand(view.applied_V, force_mN=known_force_mN(view, None))


def command_of(
    program: Program,
    player: Player,
    estimate: Estimate,
    owner: int,
    voltage_V: float,
    x_d_um: float | None,
    second: SecondCommand | UnsetType = UNSET,
) -> Command:
    """Return a command with the state of the program, before it is checked."""
    segment = player.segment
    return Command(
        epoch=estimate.epoch,
        seq=estimate.seq,
        owner=owner,
        voltage_V=voltage_V,
        part_held=player.held,
        zero=player.zero,
        final=player.ended,
        valid=True,
        sweep=segment.sweep if isinstance(segment, PlayedSweep) and not player.ended else None,
        force_mN=known_force_mN(estimate, player),
        segment=player.index if 0 <= player.index < len(program.segments) else None,
        segment_tick=player.ticks,
        x_d_um=x_d_um,
        second=second,
    )


def telemetry_of(
    estimate: Estimate,
    before: Player,
    player: Player,
    wanted: Wanted,
    acted: tuple[Acted, ...],
    correction_um: float,
) -> Telemetry:
    """Telemetry of sample k: its references are those that the tick before set for it."""
    seen, line, touch = player.slip.confirmed, player.entry.line, player.touch
    output = wanted.output
    return Telemetry(
        epoch=estimate.epoch,
        seq=estimate.seq,
        playing=not player.ended,
        phase=player.segment.phase,
        segment=player.index,
        segment_tick=player.ticks,
        x_r_um=before.ref.x_um,
        x_d_um=wanted.x_d_um,
        force_r_mN=before.ref.force_mN,
        sliding_um=output.sliding_um,
        band_um=output.band_um,
        perturbation_mN=output.perturbation_mN,
        perturbation_error_mN=output.perturbation_error_mN,
        residual_um=output.residual_um,
        outcome=player.outcome,
        contact_x_um=None if line is None else line.x_e_um,
        contact_stiffness_mN_per_um=None if line is None else line.K_e_mN_per_um,
        held=player.held,
        acted=acted,
        paused=player.pause.active,
        touch_x_um=touch and touch.x_um,
        touch_mN=touch and touch.force_mN,
        correction_um=correction_um,
        slips=player.slip.slips,
        step_um=seen and seen.step_um,
        step_x_um=seen and seen.step.before_x_um,
        step_mN=seen and seen.force_mN,
        step_after_mN=seen and seen.after_mN,
    )


def number_out_of_bounds(telemetry: Telemetry) -> Fault | None:
    """Fault of a law that has made a number that a decoder would refuse; None without one."""
    for (name, most), number in zip(NUMBERS, NUMBERS_OF(telemetry), strict=True):
        if number is not None and not -most <= number <= most:
            return fault(FaultCode.LAW_NUMBER, **{name: number})
    if telemetry.second is UNSET:
        return None
    for (name, most), number in zip(
        SECOND_NUMBERS, SECOND_NUMBERS_OF(telemetry.second), strict=True
    ):
        if not -most <= number <= most:
            return fault(FaultCode.LAW_NUMBER, **{f"second.{name}": number})
    return None


def check_command(
    config: ControllerConfig, watches: Watches, command: Command, estimate: Estimate
) -> tuple[Watches, Command]:
    """A command as it may leave; one that is refused keeps the voltage that is applied."""
    if why := nonsense(config.voltage, command.voltage_V, command.force_mN, command.x_d_um):
        return watches, invalid_command(command, estimate, why, known=False)
    watches = watch_command(
        config.monitors,
        watch_position(config.monitors, watches, estimate.x_um),
        seq=command.seq,
        x_um=estimate.x_um,
        x_d_um=command.x_d_um,
        force_mN=command.force_mN,
    )
    found = finding(config.monitors, watches)
    if found is None:
        return watches, command
    return watches, invalid_command(command, estimate, found.fault, known=True)


def invalid_command(command: Command, estimate: Estimate, why: Fault, *, known: bool) -> Command:
    """A command that keeps the applied voltage; ``known``: whether force and x_d are finite."""
    return replace(
        command,
        voltage_V=estimate.applied_V,
        zero=False,
        final=False,
        valid=False,
        fault=why,
        sweep=None,
        force_mN=command.force_mN if known else None,
        x_d_um=command.x_d_um if known else None,
        second=_kept_of_second(command, estimate, known=known),
    )


def _kept_of_second(
    command: Command, estimate: Estimate, *, known: bool
) -> SecondCommand | UnsetType:
    second = command.second
    if second is UNSET or estimate.second is UNSET:
        return second
    if not known:
        return SecondCommand(estimate.second.applied_V)
    return replace(second, voltage_V=estimate.second.applied_V)
