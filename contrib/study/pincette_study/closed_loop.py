"""Closed loop: a program played by the real services, which talk to simulated instruments."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields
from math import sqrt
from multiprocessing import get_context

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from pincette.config import RigFile, derived
from pincette.control.laws.definition import LawSettings
from pincette.control.planning.contact_plan import ContactPlan
from pincette.control.planning.path_shapes import sinusoid
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette.control.planning.segments import paths_of
from pincette.control.planning.track_plan import TrackRequest, plan_track
from pincette.core.messages import Applied, Estimate, GroundTruth, Message, Telemetry
from pincette.core.wording import applied_text
from pincette.engine.composed import ComposedLoop
from pincette_study import printed

Series = NDArray[np.float64]

LOWEST_MN = 4.0
"""Force at the trough of the path, in mN, so that the part stays pressed despite the loop's
errors."""
CYCLES = 6


@dataclass(frozen=True, slots=True)
class Record:
    """One phase of a run, sample by sample."""

    t_s: Series
    x_um: Series
    """Measured position, in µm."""
    x_r_um: Series
    true_x_um: Series
    force_mN: Series
    """Estimated force, in mN."""
    force_r_mN: Series
    true_force_mN: Series
    voltage_V: Series
    sliding_um: Series
    band_um: Series
    perturbation_error_mN: Series
    residual_um: Series
    stiffness_mN_per_um: float
    """Stiffness K_e of the contact line that contains the references."""

    @property
    def true_stiffness(self) -> float:
        """Return K_e from true force and position, in mN/µm."""
        return float(np.polyfit(self.true_x_um, self.true_force_mN, 1)[0])


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of a tracked path: r.m.s. in per cent of peak to peak, and largest."""

    position_um: float
    position_percent: float
    force_mN: float
    force_percent: float
    largest_um: float
    largest_mN: float
    true_position_percent: float
    estimated_force_percent: float


class StudyError(RuntimeError):
    """Error of a run that did not finish; the text says how it ended."""


def tracking_plan(
    rig: RigFile,
    *,
    frequency_hz: float = printed.FREQUENCY_HZ,
    x_pp_um: float = printed.X_PP_UM,
    stiffness_mN_per_um: float | None = None,
    cycles: int | None = None,
) -> ContactPlan:
    """Plan the paper's sinusoid on the contact line of the rig file's part, or on another one.

    ``cycles`` is the number of cycles at full amplitude; if it is None, they last as long as six
    cycles of the paper.
    """
    K_e = stiffness_mN_per_um or rig.part.stiffness_mN_per_um
    force_pp_mN = K_e * x_pp_um
    part, grip = rig.part, rig.grip
    if cycles is None:
        cycles = max(CYCLES, round(CYCLES * frequency_hz / printed.FREQUENCY_HZ))
    return plan_track(
        TrackRequest(
            load_s=grip.load_s,
            approach_um_per_s=grip.approach_um_per_s,
            seek_um_per_s=grip.seek_um_per_s,
            contact_force_mN=grip.contact_force_mN,
            zero_s=grip.zero_s,
            contact_um=part.contact_um,
            contact_tolerance_um=part.contact_tolerance_um,
            stiffness_mN_per_um=K_e,
            stiffness_tolerance=part.stiffness_tolerance,
            path=sinusoid(
                "force", LOWEST_MN + 0.5 * force_pp_mN, force_pp_mN, frequency_hz, cycles
            ),
            rate_um_per_s=1e3,
            acceleration_um_per_s2=1e6,
            pointer="",
        ),
        derived.planned_rig(rig),
    )


def play(rig: RigFile, program: Program) -> list[Message]:
    """Play a program on a rig that starts unpoled; return every message in order."""
    return ComposedLoop(rig).play(program)


def outcome(messages: Sequence[Message]) -> str:
    """Return the last outcome that the controller reported; empty if there is none."""
    outcomes = [m.outcome for m in messages if isinstance(m, Telemetry) and m.outcome]
    return outcomes[-1] if outcomes else ""


def record(messages: Sequence[Message], phase: str, period_s: float) -> Record:
    """Return the columns of one phase; raises StudyError if the run did not contain the phase."""
    views = [m for m in messages if isinstance(m, Telemetry) and m.phase == phase]
    if not views:
        tripped = [applied_text(m) for m in messages if isinstance(m, Applied) and m.cause]
        raise StudyError(f"no {phase}: ended {outcome(messages) or tripped[-1:]}")
    estimates = {m.seq: m for m in messages if isinstance(m, Estimate)}
    # The rig's count continues over several programs; the loop's count restarts with each.
    ground_truth = [m for m in messages if isinstance(m, GroundTruth)]
    truths = {m.seq - ground_truth[0].seq: m for m in ground_truth}
    rows = [
        (
            view.arms[0].x_r_um,
            view.force_r_mN,
            view.sliding_um,
            view.band_um,
            view.perturbation_error_mN,
            view.residual_um,
            estimates[view.seq].arms[0].x_um,
            estimates[view.seq].arms[0].force_mN,
            estimates[view.seq].arms[0].applied_V,
            truths[view.seq].arms[0].x_um,
            truths[view.seq].arms[0].force_mN,
        )
        for view in views
    ]
    columns = np.array(rows).T
    return Record(
        t_s=period_s * np.arange(len(views), dtype=np.float64),
        x_r_um=columns[0],
        force_r_mN=columns[1],
        sliding_um=columns[2],
        band_um=columns[3],
        perturbation_error_mN=columns[4],
        residual_um=columns[5],
        x_um=columns[6],
        force_mN=columns[7],
        voltage_V=columns[8],
        true_x_um=columns[9],
        true_force_mN=columns[10],
        stiffness_mN_per_um=views[-1].contact_stiffness_mN_per_um or 0.0,
    )


@dataclass(frozen=True, slots=True)
class Trial:
    """Control law to test on one rig, and the contact plan whose path it tracks."""

    rig: RigFile
    settings: LawSettings
    plan: ContactPlan
    identified: bool = True
    """True if the references lie on the contact line identified during the load; False for the
    plan's line."""


def track(
    rig: RigFile, settings: LawSettings, plan: ContactPlan, *, identified: bool = True
) -> tuple[Record, Errors]:
    """Track a path with one law; return the errors of its cycles at full amplitude."""
    return track_all([Trial(rig, settings, plan, identified)])[0]


def track_all(trials: Sequence[Trial], workers: int = 1) -> list[tuple[Record, Errors]]:
    """Track all trials in this number of processes.

    Raises StudyError if a trial does not reach its path.
    """
    if workers == 1 or len(trials) < 2:
        return [_track(trial) for trial in trials]
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        return list(pool.map(_track, trials))


def _track(trial: Trial) -> tuple[Record, Errors]:
    line = "identified" if trial.identified else "planned"
    program = replace(trial.plan.program, laws=(trial.settings.spec(),), contact_line=line)
    path = next(path for segment in program.segments for path in paths_of(segment))
    found = tracked(play(trial.rig, program), path, trial.rig.rig.period_s)
    return found, errors(found)


def tracked(messages: Sequence[Message], path: Path, period_s: float, cycle: int = 0) -> Record:
    """Return the samples of a path at full amplitude, from the cycle with this index; raises
    StudyError.

    The references of a sample were set in the tick before it.
    """
    seen = record(messages, "track", period_s)
    begin_s = path.full_from_s + cycle * path.cycle_s
    full = slice(round(begin_s / period_s), round(path.full_to_s / period_s))
    series = {
        each.name: getattr(seen, each.name)[full]
        for each in fields(seen)
        if each.name != "stiffness_mN_per_um"
    }
    series["t_s"] -= series["t_s"][0]
    return Record(**series, stiffness_mN_per_um=seen.stiffness_mN_per_um)


def errors(found: Record) -> Errors:
    """Return the errors of measured position and true force relative to the references."""
    x_pp = float(np.ptp(found.x_r_um))
    force_pp = float(np.ptp(found.force_r_mN))
    x_error = found.x_um - found.x_r_um
    force_error = found.true_force_mN - found.force_r_mN
    return Errors(
        position_um=rms(x_error),
        position_percent=100.0 * rms(x_error) / x_pp,
        force_mN=rms(force_error),
        force_percent=100.0 * rms(force_error) / force_pp,
        largest_um=float(np.max(np.abs(x_error))),
        largest_mN=float(np.max(np.abs(force_error))),
        true_position_percent=100.0 * rms(found.true_x_um - found.x_r_um) / x_pp,
        estimated_force_percent=100.0 * rms(found.force_mN - found.force_r_mN) / force_pp,
    )


def rms(values: Series) -> float:
    """Return the root mean square."""
    return sqrt(float(np.mean(values**2)))
