"""A grip and a track as received over the bus: prepared samples, the same in every run."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import sin
from random import Random

from pincette.config import read_rig
from pincette.control.arm.plant import consistent_arm, discretize
from pincette.control.planning.path_shapes import sinusoid
from pincette.control.record import replace
from pincette.core.faults import Cause, Mode, Outcome
from pincette.core.messages import (
    Applied,
    Command,
    Estimate,
    GroundTruth,
    Message,
    Position,
    Telemetry,
    Timing,
)
from pincette.core.messages.arms import (
    ArmApplied,
    ArmCommand,
    ArmEstimate,
    ArmPosition,
    ArmTelemetry,
    ArmTruth,
)
from pincette.records.columns import Columns
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Planned, Run
from tests.support import recorded
from tests.support.arms import with_arm
from tests.support.rigs import DEMO

PERIOD_S = 0.02
PLANT = discretize(consistent_arm(2437.8, 0.026, 19.0, 0.46), PERIOD_S)
CONTACT_UM, STIFFNESS = 31.2, 2.11
PHASES = (
    ("zero", 20, 0.0, 0.0),
    ("approach", 50, 26.0, 0.0),
    ("contact", 30, 32.0, 1.7),
    ("load", 40, CONTACT_UM + 20.0 / STIFFNESS, 20.0),
    ("hold", 70, CONTACT_UM + 20.0 / STIFFNESS, 20.0),
    ("unload", 30, CONTACT_UM, 0.0),
    ("retreat", 30, 0.0, 0.0),
)
"""Phase, ticks, position and force at its end."""
PATH = sinusoid("force", 12.0, 20.0, 0.5, 2)
HELD = ("load", "hold", "settle", "track", "unload")
FORCE_ERROR_MN = 0.25
TRUE_ERROR_MN = -0.4
"""Error of the true force along the path."""
UNCERTAINTY_MN = 0.5
HANG_TICKS = 5


@lru_cache
def planned(kind: str) -> Planned:
    """Return the plan of a grip with 20 mN, or of a track along ``PATH``, on the demo rig."""
    path = {"force_mean_mN": 12.0, "force_pp_mN": 20.0, "frequency_hz": 0.5, "cycles": 2}
    body = {"kind": kind, **({"force_mN": 20.0} if kind == "grip" else path)}
    return plan_job(REQUEST.validate_python(body), read_rig(DEMO))


def run_of(kind: str, table: Columns) -> Run:
    """Return the data that such a job has collected."""
    return Run(planned(kind).model.rig, planned(kind), table)


@dataclass(frozen=True)
class Tick:
    """The five messages of one sample, and the truth behind it."""

    position: Position
    estimate: Estimate
    command: Command
    telemetry: Telemetry
    applied: Applied
    truth: GroundTruth

    def messages(self) -> tuple[Message, ...]:
        return (
            self.position,
            self.estimate,
            self.command,
            self.telemetry,
            self.applied,
            self.truth,
        )


def references(times: int = 1) -> Iterator[tuple[str, int, float, float]]:
    """Return phase, its number, x_r and F_r of each tick, moving smoothly from one to the next.

    ``times`` multiplies the ticks of each phase.
    """
    x_um = force_mN = 0.0
    for number, (phase, ticks, x_to_um, force_to_mN) in enumerate(PHASES):
        for tick in range(times * ticks):
            share = (tick + 1) / (times * ticks)
            share = share * share * (3.0 - 2.0 * share)
            step_x, step_force = share * (x_to_um - x_um), share * (force_to_mN - force_mN)
            yield phase, number, x_um + step_x, force_mN + step_force
        x_um, force_mN = x_to_um, force_to_mN


def grip(epoch: int = 7) -> list[Tick]:
    """Return a whole grip: the estimate has the error FORCE_ERROR_MN in the hold, x a small
    ripple."""
    return [*_grip(epoch)]


@lru_cache(maxsize=4)
def _grip(epoch: int) -> list[Tick]:
    return _ended([_tick(epoch, seq, *reference) for seq, reference in enumerate(references())])


def slow_grip(times: int) -> list[Tick]:
    """Return a grip whose phases all take ``times`` as many ticks."""
    return _ended([_tick(7, seq, *reference) for seq, reference in enumerate(references(times))])


def track(epoch: int = 7) -> list[Tick]:
    """Return a load, PATH, and an unload: the estimate has the error FORCE_ERROR_MN along the
    path."""
    ticks: list[Tick] = []
    before = ("load", 0, CONTACT_UM + 12.0 / STIFFNESS, 12.0)
    for seq in range(50):
        share = (seq + 1) / 50
        ticks.append(_tick(epoch, seq, "load", 0, CONTACT_UM + share * 5.0, share * 12.0))
    for number in range(1, round(PATH.duration_s / PERIOD_S) + 1):
        tick = _tick(epoch, len(ticks), "track", *before[1:])
        telemetry = replace(tick.telemetry, segment_tick=number)
        truth = with_arm(tick.truth, force_mN=before[3] + TRUE_ERROR_MN)
        ticks.append(replace(tick, telemetry=telemetry, truth=truth))
        # The controller's references of this tick apply to the next sample.
        force_mN = PATH.at(number * PERIOD_S)
        before = ("track", 1, CONTACT_UM + force_mN / STIFFNESS, force_mN)
    for _ in range(10):
        ticks.append(_tick(epoch, len(ticks), "unload", 2, CONTACT_UM, 0.0))
    reported = [replace(tick.telemetry, outcome=Outcome.TRACKED) for tick in ticks[-10:]]
    ticks[-10:] = [replace(t, telemetry=s) for t, s in zip(ticks[-10:], reported, strict=True)]
    return _ended(ticks)


def rest(epoch: int = 7, noise_um: float = 0.03, ticks: int = 200) -> list[Tick]:
    """Return a calibration of the noise: an arm at rest, with the same noise in every run."""
    chance = Random(1)
    made = [_still(epoch, seq, "noise", 0, noise_um * chance.gauss()) for seq in range(ticks)]
    return _moved(made)


def weighing(epoch: int, steps: Sequence[float], compliance_um_per_mN: float) -> list[Tick]:
    """A calibration by weights: each step waits for HANG_TICKS, settles, and is measured."""
    made: list[Tick] = []
    chance = Random(2)
    for step, weight_mN in enumerate(steps):
        x_um = -compliance_um_per_mN * weight_mN
        pieces = (("hang", HANG_TICKS), ("settle", 10), ("measure", 50))
        for piece, (phase, ticks) in enumerate(pieces):
            for _ in range(ticks):
                number, name = 3 * step + piece, f"{phase} {step + 1}"
                noise_um = 0.01 * chance.gauss()
                made.append(_still(epoch, len(made), name, number, x_um + noise_um))
    return _moved(made)


def numbered(tick: Tick, seq: int) -> Tick:
    """Return the same sample with another number."""
    return Tick(
        replace(tick.position, seq=seq, t_s=seq * PERIOD_S),
        replace(tick.estimate, seq=seq, applied_seq=seq - 1),
        replace(tick.command, seq=seq),
        replace(tick.telemetry, seq=seq),
        replace(tick.applied, seq=seq),
        replace(tick.truth, seq=seq),
    )


def _still(epoch: int, seq: int, phase: str, segment: int, x_um: float) -> Tick:
    """Return a sample at a constant voltage."""
    tick = _tick(epoch, seq, phase, segment, 0.0, 0.0)
    return replace(
        tick,
        position=with_arm(tick.position, x_um=x_um),
        applied=with_arm(tick.applied, voltage_V=0.0),
    )


def _moved(ticks: list[Tick]) -> list[Tick]:
    last = ticks[-1]
    ticks[-1] = replace(last, telemetry=replace(last.telemetry, outcome=Outcome.MOVED))
    return _ended(ticks)


def _ended(ticks: list[Tick]) -> list[Tick]:
    last = ticks[-1]
    ticks[-1] = replace(
        last,
        command=replace(last.command, final=True),
        telemetry=replace(last.telemetry, playing=False),
        applied=replace(last.applied, final=True, state="idle"),
    )
    return ticks


def _tick(epoch: int, seq: int, phase: str, segment: int, x_r_um: float, force_r_mN: float) -> Tick:
    held = phase in HELD
    error_mN = FORCE_ERROR_MN if phase in ("hold", "track") else 0.0
    x_um = x_r_um + 0.03 * sin(0.7 * seq)
    voltage_V = (x_um + 0.46 * force_r_mN) / 19.0
    known = phase in ("hold", "track", "unload", "retreat")
    return Tick(
        Position(epoch, seq, seq * PERIOD_S, (ArmPosition(x_um, valid=True),)),
        Estimate(
            epoch=epoch,
            seq=seq,
            applied_seq=seq - 1,
            tripped=False,
            degraded=False,
            arms=(
                ArmEstimate(
                    x_um=x_um,
                    force_mN=force_r_mN + error_mN,
                    force_uncertainty_mN=UNCERTAINTY_MN,
                    perturbation_mN=0.0,
                    zero_age_s=None if phase == "zero" else (seq - 20) * PERIOD_S,
                    zero_refusal=None,
                    applied_V=voltage_V,
                    limits_active=0,
                ),
            ),
            valid=True,
        ),
        Command(epoch, seq, 1, (ArmCommand(voltage_V),), held, seq == 19, final=False, valid=True),
        Telemetry(
            epoch=epoch,
            seq=seq,
            playing=True,
            phase=phase,
            segment=segment,
            segment_tick=0,
            arms=(ArmTelemetry(x_r_um, x_r_um),),
            force_r_mN=force_r_mN,
            sliding_um=0.02 * sin(1.3 * seq),
            band_um=0.01,
            perturbation_mN=0.2,
            perturbation_error_mN=0.1,
            residual_um=-0.05,
            outcome=Outcome.GRIPPED if phase in ("unload", "retreat") else Outcome.NONE,
            contact_x_um=CONTACT_UM if known else None,
            contact_stiffness_mN_per_um=STIFFNESS if known else None,
            held=held,
            acted=(),
        ),
        Applied(
            epoch=epoch,
            seq=seq,
            arms=(ArmApplied(voltage_V, 4 if phase == "approach" and seq < 25 else 0),),
            state=Mode.ARMED,
            cause=Cause.NONE,
            part_held=held,
            zero=seq == 19,
            final=False,
            answered=True,
            refused=0,
            command_age_s=0.008,
        ),
        GroundTruth(seq, (ArmTruth(x_um, force_r_mN, voltage_V),)),
    )


def timing(service: str, seq: int) -> Timing:
    """Return a program's report of its punctuality: once it was late by 1 ms."""
    return recorded.timing(service, seq, 1e-3)
