"""Beyond the paper: the identified response in the law, a residual run, learning, and grips.

The model consists of play operators with fading, which resemble Bouc-Wen hysteresis, so that rigs
of this class favour the model; rigs with relays do not.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from pincette.config import RigFile
from pincette.config.laws import law_definition
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette.control.planning.repetition import cycle_ticks, no_corrections
from pincette.control.planning.segments import paths_of
from pincette.core.messages import GroundTruth, Message, Telemetry
from pincette_study.calibrated import line_of, with_line
from pincette_study.calibrated_free import with_calibrated_response
from pincette_study.closed_loop import (
    Errors,
    StudyError,
    errors,
    outcome,
    rms,
    tracked,
    tracking_plan,
)
from pincette_study.desk import Desk
from pincette_study.precision import FREQUENCIES_HZ, SCHEMES
from pincette_study.rigs import Draw, random_relay_rig, random_rig
from pincette_supervisor.plugin import Planned

CLASSES: Mapping[str, Callable[[RigFile, int], tuple[RigFile, Draw]]] = {
    "bouc_wen": random_rig,
    "relays": random_relay_rig,
}
FIRST_SEED = 201
"""First seed of the rigs. Gains and models were chosen with seeds below 121."""
REACH_UM = (-70.0, 120.0)
"""Lower and upper limit of the position in µm. They are wide, since the calibration's cycles go 1 V
below the rest voltage, and relays shift the rest position.
"""
CYCLES = {0.5: 6, 2.0: 12, 5.0: 20}
"""Number of cycles at full amplitude, by frequency in Hz."""
LEARNED_CYCLES = 10
AFTER_CYCLES = {0.5: 2, 2.0: 4, 5.0: 10}
"""Number of cycles of the same path after learning, by frequency in Hz; the error is computed from
these."""
PROFILES = ("quick", "gentle")


@dataclass(frozen=True, slots=True)
class BeyondTrial:
    """Result of a law on a random rig at one frequency."""

    hysteresis: str
    """Class of hysteresis; one of ``CLASSES``."""
    draw: Draw
    scheme: str
    frequency_hz: float
    errors: Errors
    prepared: str = ""
    """Preparation in addition to the calibrations: ``dry_run``, ``learned``, or empty for none."""
    cycles_percent: tuple[float, ...] = ()
    """R.m.s. position error of each cycle in per cent, if the law learns from cycles."""


@dataclass(frozen=True, slots=True)
class GripTrial:
    """Result of a grip on a random rig."""

    hysteresis: str
    draw: Draw
    profile: str
    seconds_without_hold: float
    peak_over_planned: float
    """Largest true force divided by the planned one."""
    hold_error_percent: float
    """R.m.s. of the true minus the planned force during the hold, in per cent."""


class BeyondTrials(NamedTuple):
    """Results of one rig, or of all rigs."""

    tracks: list[BeyondTrial]
    grips: list[GripTrial]


def run_beyond(
    base: RigFile,
    rigs: int,
    progress: Callable[[int], None] | None = None,
    workers: int = 1,
) -> BeyondTrials:
    """Draw, calibrate, grip and track: every class, scheme and frequency, in this order.

    ``progress`` receives the number of finished rigs, over all classes.
    """
    trials = BeyondTrials([], [])
    for done, found in enumerate(_by_rig(base, rigs, workers), start=1):
        trials.tracks.extend(found.tracks)
        trials.grips.extend(found.grips)
        if progress is not None:
            progress(done)
    return trials


def _by_rig(base: RigFile, rigs: int, workers: int) -> Iterator[BeyondTrials]:
    drawn = [(name, FIRST_SEED + number) for name in CLASSES for number in range(rigs)]
    one = partial(on_rig, base)
    if workers == 1:
        yield from map(one, drawn)
        return
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        yield from pool.map(one, drawn)


def prepared_rig(base: RigFile, drawn: tuple[str, int]) -> tuple[RigFile, Draw]:
    """Draw a rig, given by class and seed, calibrate its free response, and press its part."""
    name, seed = drawn
    rig, draw = CLASSES[name](base, seed)
    # No law set is given: the default set is used once a free response is identified.
    update = {
        "law": rig.law.model_copy(update={"set": None}),
        "limits": rig.limits.model_copy(
            update={"position_min_um": REACH_UM[0], "position_max_um": REACH_UM[1]}
        ),
    }
    taught = with_calibrated_response(rig.model_copy(update=update))
    desk = Desk(taught)
    desk.stroke()
    return with_line(taught, *line_of(desk.play(tracking_plan(taught).program))).rig, draw


def on_rig(base: RigFile, drawn: tuple[str, int]) -> BeyondTrials:
    """Run all jobs, one after the other, with default gains, on one rig given by class and seed.

    Before the first job the arm strokes over its range, which erases its earlier history. The model
    does not know that history, since relays and play operators differ in their initial state.
    Memory and creep are kept from job to job.
    """
    rig, draw = prepared_rig(base, drawn)
    desk = Desk(rig)
    desk.stroke()
    found = BeyondTrials([], [])
    for profile in PROFILES:
        found.grips.append(grip_trial(rig, drawn[0], draw, profile, *desk.grip(profile)))
    for frequency_hz in FREQUENCIES_HZ:
        found.tracks.extend(_tracks(desk, drawn[0], draw, frequency_hz))
    return found


def _tracks(desk: Desk, name: str, draw: Draw, frequency_hz: float) -> Iterator[BeyondTrial]:
    """Track without preparation, then with corrections from a run without the part, then with
    learning.
    """
    rig, period_s = desk.rig, desk.rig.rig.period_s

    def program(scheme: str, cycles: int) -> tuple[Program, Path]:
        plan = tracking_plan(rig, frequency_hz=frequency_hz, cycles=cycles)
        settings = law_definition(scheme).settings(rig.law_set)
        path = next(path for s in plan.program.segments for path in paths_of(s))
        return replace(plan.program, laws=(settings.spec(),), contact_line="identified"), path

    def trial(scheme: str, played: list[Message], path: Path, prepared: str) -> BeyondTrial:
        learns = prepared == "learned"
        of_cycles = _cycles_percent(played, path, period_s) if learns else ()
        seen = tracked(played, path, period_s, LEARNED_CYCLES if learns else 0)
        return BeyondTrial(name, draw, scheme, frequency_hz, errors(seen), prepared, of_cycles)

    record: list[tuple[Program, list[Message]]] = []
    for scheme in SCHEMES:
        made, path = program(scheme, CYCLES[frequency_hz])
        record.append((made, desk.play(made)))
        yield trial(scheme, record[-1][1], path, "")
    # Both schemes play the same motion, so one table of corrections is enough.
    known = desk.residual(*record[0])
    for scheme in SCHEMES if known is not None else ():
        made, path = program(scheme, CYCLES[frequency_hz])
        yield trial(scheme, desk.play(made, known), path, "dry_run")
    for scheme in SCHEMES:
        made, path = program(scheme, LEARNED_CYCLES + AFTER_CYCLES[frequency_hz])
        nothing = no_corrections(cycle_ticks(path.cycle_s, period_s))
        played = desk.play(replace(made, corrections=nothing))
        yield trial(scheme, played, path, "learned")


def _cycles_percent(played: Sequence[Message], path: Path, period_s: float) -> tuple[float, ...]:
    seen = tracked(played, path, period_s)
    pp_um = float(np.ptp(seen.x_r_um))
    each = np.split(seen.x_um - seen.x_r_um, path.cycles)
    return tuple(100.0 * rms(error_um) / pp_um for error_um in each)


def grip_trial(
    rig: RigFile, name: str, draw: Draw, profile: str, planned: Planned, played: list[Message]
) -> GripTrial:
    """Return time and forces of a grip; raises StudyError if the part was not held."""
    if outcome(played) != "gripped":
        raise StudyError(f"the {profile} grip of {name} rig {draw.seed} ended {outcome(played)!r}")
    views = [m for m in played if isinstance(m, Telemetry)]
    ground_truth = [m for m in played if isinstance(m, GroundTruth)]
    true_mN = {m.seq - ground_truth[0].seq: m.arms[0].force_mN for m in ground_truth}
    hold = [view.seq for view in views if view.phase == "hold"]
    force_mN: float = planned.values["force_mN"]
    held_mN = np.array([true_mN[seq] for seq in hold])
    return GripTrial(
        name,
        draw,
        profile,
        seconds_without_hold=rig.rig.period_s * (len(views) - len(hold)),
        peak_over_planned=max(true_mN.values()) / force_mN,
        hold_error_percent=100.0 * rms(held_mN - force_mN) / force_mN,
    )
