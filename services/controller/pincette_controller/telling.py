"""What the controller tells beside its commands: that it has none, and how it sees a sample."""

from dataclasses import fields

from pincette.codec.bounds import largest
from pincette.control.laws.law import LawState
from pincette.control.laws.sliding import LawOutput
from pincette.messages import Command, Estimate, Telemetry
from pincette_controller.playing import Player

NUMBERS = tuple(
    (field.name, largest(field.name)) for field in fields(Telemetry) if "float" in str(field.type)
)
"""Of telemetry, each with its largest magnitude."""


def known_mN(estimate: Estimate) -> float | None:
    """The force, where there is a valid zero."""
    return estimate.force_mN if estimate.valid and estimate.zero_age_s is not None else None


def no_command(estimate: Estimate, epoch: int, owner: int, silenced: str) -> Command:
    """An invalid command; it tells the force, which a part that is frozen is watched by.

    ``silenced`` is why a controller that sees commands no more.
    """
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
        force_mN=known_mN(estimate),
    )


def telemetry_of(
    estimate: Estimate,
    before: Player,
    memory: LawState,
    player: Player,
    output: LawOutput,
    acted: str,
) -> Telemetry:
    """How sample k looks: its references are those that the tick before set for it."""
    return Telemetry(
        epoch=estimate.epoch,
        seq=estimate.seq,
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


def unsayable(telemetry: Telemetry) -> str:
    """Which number nobody would take, as one that is not finite; empty where all can be told.

    A law has gone astray by then, though its voltage may still look sound.
    """
    for name, most in NUMBERS:
        number = getattr(telemetry, name)
        if number is not None and not -most <= number <= most:
            return f"the law: {name} = {number}"
    return ""
