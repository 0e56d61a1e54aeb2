"""Plan and result of a tracked path."""

from collections.abc import Sequence

import numpy as np

from pincette.config import derived
from pincette.control.arm.plant import DifferenceEquation
from pincette.control.planning.path_shapes import peaks
from pincette.control.planning.paths import Path
from pincette.control.planning.track_plan import TrackRequest, plan_track
from pincette.records.columns import Columns
from pincette_supervisor.kinds import pairs
from pincette_supervisor.kinds.track import Tracking, TrackJobRequest, TrackResult
from pincette_supervisor.kinds.track.cycles import (
    cycle_errors,
    judged,
    kept,
    learned_of,
    learning,
    told_of,
    whole_cycle,
)
from pincette_supervisor.kinds.track.pair import plan_pair
from pincette_supervisor.kinds.track.path import path_values, requested_path
from pincette_supervisor.kinds.track.plot import plot
from pincette_supervisor.plugin import (
    Evaluation,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
    Run,
    figures,
    learning_digest,
)
from pincette_supervisor.plugin.figures import (
    Mask,
    Series,
    common,
    force_error,
    position_error,
    series,
    sources_of,
    within,
)
from pincette_supervisor.plugin.plans import (
    CONTACT_FIELDS,
    arm_touch,
    conditioning_V,
    contact_job,
    contact_pointer,
    contact_values,
    part_values,
    slowed,
)

LEARNED_CYCLES = 3
"""The last ones of a path that is learned, which its errors are told apart by: until then what it
learns changes from cycle to cycle, and would pass for noise."""


def plan(request: TrackJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a tracked path of one arm, or the paths of force and place of two."""
    rig = model.rig
    if rig.second is not None:
        return plan_pair(request, model, present)
    contact = contact_values(request, CONTACT_FIELDS, rig)
    values = path_values(request, rig)
    path, pointer = requested_path(request, values, rig.part.stiffness_mN_per_um)
    found = peaks(path)
    touch = arm_touch(rig, found.highest, contact["contact_force_mN"])
    contact = slowed(contact, request, touch)
    track = TrackRequest(
        **contact,
        **part_values(rig),
        path=path,
        rate_um_per_s=values["rate_um_per_s"],
        acceleration_um_per_s2=values["acceleration_um_per_s2"],
        pointer=pointer,
    )
    low_V = conditioning_V(request, rig)
    made = plan_track(track, derived.planned_rig(rig, present.x_um, low_V, present.rest_um()))
    planned = contact_job(
        request, model, made, (found.lowest, found.highest), {**values, **contact}, present, pointer
    )
    return learning(planned, path, rig.rig.period_s) if request.learn else planned


def evaluate(run: Run) -> Evaluation:
    """Work out the figures of a tracked path."""
    if run.rig.second is not None:
        return pairs.evaluate(run)
    path = run.planned.path
    if path is None:
        raise ValueError("the program of a track has no path")
    result = track_result(
        run.table,
        plant=run.plant,
        path=path,
        period_s=run.period_s,
        dropped=run.dropped,
        force_assumed=run.force_assumed,
    )
    learned = learned_of(run, path)
    cycles = path.cycles if learned is None else min(LEARNED_CYCLES, path.cycles)
    found = sources_of(
        run.table,
        full_amplitude(run.table, path, run.period_s, cycles),
        run.planned.armed.rig,
        cycle_ticks=whole_cycle(path, run.period_s),
    )
    result = result.model_copy(update={"error_sources": found})
    if learned is not None:
        held = judged(run, learned, result.cycles)
        name = learning_digest(run.planned.program, run.planned.armed.rig)
        result = result.model_copy(update={"learned": told_of(learned, name, held)})
        learned = kept(learned) if held is not None and held.helps else None
    return Evaluation(result, learned=learned)


def track_result(
    table: Columns,
    *,
    plant: DifferenceEquation,
    path: Path,
    period_s: float,
    dropped: int,
    force_assumed: Sequence[str] = (),
) -> TrackResult:
    """Figures of a track job; ``plant`` is the arm as the law's parameter set has it."""
    full, track = full_amplitude(table, path, period_s), within(table, ["track"])
    force_r = series(table, "force_r_mN")
    x_pp_um = figures.peak_to_peak(series(table, "x_r_um"), full)
    force_pp_mN = figures.peak_to_peak(force_r, full)
    position = _tracking(position_error(table), full, x_pp_um)
    force = _tracking(force_error(table), full, force_pp_mN)
    true_force = _tracking(series(table, "true_force_mN") - force_r, full, force_pp_mN)
    return TrackResult(
        **common(
            table,
            plant=plant,
            period_s=period_s,
            dropped=dropped,
            force_assumed=force_assumed,
        ),
        shape=path.shape,
        x_pp_um=x_pp_um,
        force_pp_mN=force_pp_mN,
        tracked_samples=int(full.sum()),
        position_um=position,
        force_mN=force,
        true_force_mN=true_force,
        force_uncertainty_mN=figures.mean(series(table, "force_uncertainty_mN"), full),
        zero_age_s=figures.last_of(table, "zero_age_s", track),
        cycles=cycle_errors(table, path, period_s, full),
    )


def full_amplitude(table: Columns, path: Path, period_s: float, cycles: int = 0) -> Mask:
    """Samples whose references are on the path at full amplitude, whole cycles where it swings.

    ``cycles``: the last ones alone, of a path that has some; 0: all.
    The references of a sample are those of the tick before it, hence of ``segment_tick`` - 1.
    """
    t_s = (series(table, "segment_tick") - 1.0) * period_s
    slack_s = 1e-6 * period_s
    from_s = path.full_from_s
    if cycles:
        from_s = max(from_s, path.full_to_s - cycles * path.cycle_s)
    since, until = t_s > from_s - slack_s, t_s < path.full_to_s - slack_s
    return within(table, ["track"]) & (t_s >= 0.0) & since & until


def _tracking(error: Series, full: Mask, pp: float | None) -> Tracking | None:
    """Errors over the samples chosen; None without one."""
    rmse = figures.rms(error, full)
    most = figures.largest(np.abs(error), full)
    if rmse is None or most is None:
        return None
    percent = 100.0 * rmse / pp if pp else None
    return Tracking(rmse=rmse, rmse_percent=percent, maximum=most)


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot, pointer=contact_pointer)
