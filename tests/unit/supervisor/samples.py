"""A grip as the bus would carry it: canned samples, the same on every run."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import sin

from pincette.messages import Applied, Command, Estimate, Message, Position, Telemetry, Truth

PERIOD_S = 0.02
CONTACT_UM, STIFFNESS = 31.2, 2.11
PHASES = (
    ("zero", 20, 0.0, 0.0),
    ("approach", 80, 26.0, 0.0),
    ("contact", 70, 32.0, 1.7),
    ("load", 100, CONTACT_UM + 20.0 / STIFFNESS, 20.0),
    ("hold", 200, CONTACT_UM + 20.0 / STIFFNESS, 20.0),
    ("unload", 100, CONTACT_UM, 0.0),
    ("retreat", 100, 0.0, 0.0),
)
"""Phase, ticks, position and force at its end."""
FORCE_ERROR_MN = 0.25
UNCERTAINTY_MN = 0.5


@dataclass(frozen=True)
class Tick:
    """The five messages of one sample, and the truth behind it."""

    position: Position
    estimate: Estimate
    command: Command
    telemetry: Telemetry
    applied: Applied
    truth: Truth

    def messages(self) -> tuple[Message, ...]:
        return (
            self.position,
            self.estimate,
            self.command,
            self.telemetry,
            self.applied,
            self.truth,
        )


def references() -> Iterator[tuple[str, int, float, float]]:
    """Phase, its number, x_r and F_r of each tick, moving smoothly from one to the next."""
    x_um = force_mN = 0.0
    for number, (phase, ticks, x_to_um, force_to_mN) in enumerate(PHASES):
        for tick in range(ticks):
            share = (tick + 1) / ticks
            share = share * share * (3.0 - 2.0 * share)
            step_x, step_force = share * (x_to_um - x_um), share * (force_to_mN - force_mN)
            yield phase, number, x_um + step_x, force_mN + step_force
        x_um, force_mN = x_to_um, force_to_mN


def grip(epoch: int = 7) -> list[Tick]:
    """A whole grip: the estimate errs by FORCE_ERROR_MN in the hold, x by a small ripple."""
    ticks = [_tick(epoch, seq, *reference) for seq, reference in enumerate(references())]
    last = ticks[-1]
    ticks[-1] = replace(
        last,
        command=replace(last.command, final=True),
        telemetry=replace(last.telemetry, playing=False),
        applied=replace(last.applied, final=True, state="idle"),
    )
    return ticks


def _tick(epoch: int, seq: int, phase: str, segment: int, x_r_um: float, force_r_mN: float) -> Tick:
    held = phase in ("load", "hold", "unload")
    error_mN = FORCE_ERROR_MN if phase == "hold" else 0.0
    x_um = x_r_um + 0.03 * sin(0.7 * seq)
    voltage_V = (x_um + 0.46 * force_r_mN) / 19.0
    known = phase in ("hold", "unload", "retreat")
    return Tick(
        Position(epoch, seq, seq * PERIOD_S, x_um, valid=True),
        Estimate(
            epoch=epoch,
            seq=seq,
            x_um=x_um,
            force_mN=force_r_mN + error_mN,
            force_uncertainty_mN=UNCERTAINTY_MN,
            perturbation_mN=0.0,
            zero_age_s=None if phase == "zero" else (seq - 20) * PERIOD_S,
            zero_refusal="",
            applied_V=voltage_V,
            applied_seq=seq - 1,
            limits_active=0,
            tripped=False,
            degraded=False,
            valid=True,
        ),
        Command(epoch, seq, 1, voltage_V, held, seq == 19, final=False, valid=True),
        Telemetry(
            epoch=epoch,
            seq=seq,
            playing=True,
            phase=phase,
            segment=segment,
            segment_tick=0,
            x_r_um=x_r_um,
            x_d_um=x_r_um,
            force_r_mN=force_r_mN,
            sliding_um=0.02 * sin(1.3 * seq),
            perturbation_error_mN=0.1,
            residual_um=-0.05,
            outcome="gripped" if phase in ("unload", "retreat") else "",
            contact_x_um=CONTACT_UM if known else None,
            contact_stiffness_mN_per_um=STIFFNESS if known else None,
            held=held,
            acted="",
        ),
        Applied(
            epoch=epoch,
            seq=seq,
            voltage_V=voltage_V,
            state="armed",
            cause="",
            limits_active=4 if phase == "approach" and seq < 25 else 0,
            part_held=held,
            zero=seq == 19,
            final=False,
            answered=True,
            refused=0,
            command_age_s=0.008,
        ),
        Truth(seq, x_um, force_r_mN, voltage_V),
    )
