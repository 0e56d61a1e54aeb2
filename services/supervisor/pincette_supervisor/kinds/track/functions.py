"""Path, plan and result of a tracked path, and learning over its cycles."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from pincette.config import RigFile, derived
from pincette.control.planning.pair_plan import PairPaths, track_program
from pincette.control.planning.path_shapes import peaks, sinusoid, steps, triangle, waypoints
from pincette.control.planning.paths import Path, Shape
from pincette.control.planning.repetition import (
    Corrections,
    CycleLearner,
    HeldOut,
    cycle_ticks,
    held_out,
    no_corrections,
)
from pincette.control.planning.segments import Track
from pincette.control.planning.track_plan import TrackRequest, plan_track
from pincette.control.record import replace as changed
from pincette.records.columns import Columns
from pincette_supervisor.kinds import pairs
from pincette_supervisor.kinds.track import (
    BY_POSITION,
    MEMBERS,
    SWING,
    CycleErrors,
    ForcePath,
    Learned,
    PlacePath,
    TrackJobRequest,
    TrackResult,
)
from pincette_supervisor.kinds.track.plot import plot
from pincette_supervisor.plugin import (
    Evaluation,
    FaultyRequestError,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
    Run,
    figures,
    learning_digest,
)
from pincette_supervisor.plugin.error_sources import sources_of
from pincette_supervisor.plugin.figures import Mask, Series, series, within
from pincette_supervisor.plugin.pair_plans import (
    STARTS_UM,
    homes_um,
    most_mN,
    pair_job,
    pair_request,
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
from pincette_supervisor.plugin.result import (
    common,
    force_error,
    full_amplitude,
    position_error,
    tracking,
)

LIMITS = ("rate_um_per_s", "acceleration_um_per_s2")
LONGEST_S = 3600.0


def requested_path(request: TrackJobRequest, rig: RigFile) -> tuple[Path, dict[str, Any], str]:
    """Return the path of one arm, its values, and the member that determines its height.

    Raises
    ------
    FaultyRequestError
        If a member does not form a path.
    """
    shape = request.shape or rig.track.shape
    members = MEMBERS[shape]
    for name in sorted({*SWING, *MEMBERS["step"], *MEMBERS["waypoints"], *BY_POSITION}):
        if getattr(request, name) is not None and BY_POSITION.get(name, name) not in members:
            raise FaultyRequestError(f"/{name}", _stray(name, shape, members))
    values: dict[str, Any] = {"shape": shape}
    if shape == "waypoints":
        values["points"] = _points(request, rig)
    for name in (*members, *LIMITS):
        if name not in values:
            value = getattr(request, name)
            values[name] = getattr(rig.track, name) if value is None else value
    if shape == "step":
        values["levels_mN"] = list(values["levels_mN"])
    K_e = rig.part.stiffness_mN_per_um
    if request.x_pp_um is not None:
        values["force_pp_mN"] = K_e * request.x_pp_um
    named = {_bare(name): values[name] for name in members}
    listed = "/points" if request.x_points is None else "/x_points"
    if shape == "waypoints":
        named["points"] = [tuple(point.values()) for point in values["points"]]
    path = _path(
        "force",
        shape,
        named,
        (K_e * values["rate_um_per_s"], K_e * values["acceleration_um_per_s2"]),
        listed if shape == "waypoints" else "",
        {"waypoints": listed, "step": "/dwell_s"}.get(shape, "/cycles"),
    )
    pointer = {"step": "/levels_mN", "waypoints": listed}.get(shape, "/force_pp_mN")
    return path, values, "/x_pp_um" if request.x_pp_um is not None else pointer


def _points(request: TrackJobRequest, rig: RigFile) -> list[dict[str, float]]:
    """Return times and forces of the requested points; raises FaultyRequestError without points."""
    if request.x_points is not None:
        K_e, contact_um = rig.part.stiffness_mN_per_um, rig.part.contact_um
        return [
            {"t_s": point.t_s, "force_mN": K_e * (point.x_um - contact_um)}
            for point in request.x_points
        ]
    if request.points is None:
        raise FaultyRequestError("/points", "points is missing: waypoints need at least two")
    return [point.model_dump() for point in request.points]


def path_of_two(path: ForcePath | PlacePath, rig: RigFile, place_um: float) -> Path:
    """Return the force or place path of a part between two arms.

    Parameters
    ----------
    place_um
        Place where the part is expected: the usual mean of a path of the place.

    Raises
    ------
    FaultyRequestError
        If a member does not form a path.
    """
    track, shape = rig.track, path.shape
    members = tuple(_bare(name) for name in MEMBERS[shape])
    usual = {
        _bare(name): getattr(track, name)
        for names in MEMBERS.values()
        for name in names
        if name != "points"
    }
    quantity: Literal["force", "position"] = "force"
    pointer, squeeze = "/force", 1.0
    if isinstance(path, ForcePath):
        squeeze = sum(arm.model.compliance_um_per_mN for arm in rig.arms)
        squeeze += 1.0 / rig.part.stiffness_mN_per_um
    else:
        quantity, pointer = "position", "/place"
        usual |= {"mean": place_um, "pp": None, "levels": None}
    values: dict[str, Any] = {}
    for field in type(path).model_fields:
        name, value = _bare(field), getattr(path, field)
        if name in members:
            values[name] = usual.get(name) if value is None else value
        elif value is not None and field != "shape":
            raise FaultyRequestError(pointer, _stray(name, shape, members))
    missing = [name for name, value in values.items() if value is None]
    if missing:
        raise FaultyRequestError(pointer, f"a {shape} of {quantity} needs {', '.join(missing)}")
    if shape == "waypoints":
        values["points"] = [tuple(point.model_dump().values()) for point in values["points"]]
    limits = track.rate_um_per_s / squeeze, track.acceleration_um_per_s2 / squeeze
    return _path(quantity, shape, values, limits, pointer, pointer)


def _bare(name: str) -> str:
    """Return the name of a member without its quantity and unit."""
    return name.removeprefix("force_").removesuffix("_mN").removesuffix("_um")


def _stray(name: str, shape: Shape, members: tuple[str, ...]) -> str:
    return f"{name} cannot be used with a {shape}, which takes {', '.join(members)}"


def _path(
    quantity: Literal["force", "position"],
    shape: Shape,
    values: Mapping[str, Any],
    limits: tuple[float, float],
    pointer: str,
    long_pointer: str,
) -> Path:
    """Return a path of the requested shape.

    Parameters
    ----------
    values
        ``mean``, ``pp``, ``frequency_hz`` and ``cycles``, or ``levels`` and ``dwell_s``, or
        ``points``.
    limits
        Highest rate and acceleration of the quantity.
    pointer, long_pointer
        Members of the request that an error names: for numbers that do not form a path, and for a
        path that is too long.

    Raises
    ------
    FaultyRequestError
        If the values do not form a path.
    """
    try:
        if shape == "step":
            path = steps(quantity, values["levels"], values["dwell_s"], *limits)
        elif shape == "waypoints":
            path = waypoints(quantity, values["points"])
        else:
            swing = values["mean"], values["pp"], values["frequency_hz"], values["cycles"]
            path = (
                triangle(quantity, *swing, limits[1])
                if shape == "triangle"
                else sinusoid(quantity, *swing)
            )
    except ValueError as error:
        raise FaultyRequestError(pointer, str(error)) from error
    if path.duration_s > LONGEST_S:
        raise FaultyRequestError(
            long_pointer, f"the path takes {path.duration_s:g} s, limit {LONGEST_S:g} s"
        )
    return path


PAIR_POINTERS = {"load": "/force", "settle": "/place", "track": "", "unload": "/force"}
LEARNED_CYCLES = 3
"""Number of last cycles of a learned path whose errors are broken down into causes.

In earlier cycles, learning changes the errors from cycle to cycle, which would count as noise.
"""
NOISE_IN_ERROR = 1.15
"""Ratio of the noise of x - x_r to the noise of a reading; it exceeds 1 since the loop follows some
of the noise.
"""


def plan(request: TrackJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a tracked path of one arm, or the paths of force and place of two arms."""
    rig = model.rig
    if rig.second is not None:
        return _plan_pair(request, model, present)
    contact = contact_values(request, CONTACT_FIELDS, rig)
    path, values, pointer = requested_path(request, rig)
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


def _plan_pair(request: TrackJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a track with two arms."""
    rig = model.rig
    if request.force is None and request.place is None:
        raise FaultyRequestError(
            "", "a track with two arms needs a path: give force, place or both"
        )
    values = contact_values(request, CONTACT_FIELDS, rig)
    force_mN = request.force_mN or rig.grip.force_mN
    made = pair_request(values, rig, force_mN, centred=request.centre)
    force, place = (
        None if path is None else path_of_two(path, rig, made.place_um)
        for path in (request.force, request.place)
    )
    paths = PairPaths(force=force, place=place)
    highest_mN = force_mN if force is None else max(force_mN, peaks(force).highest)
    homes = homes_um(rig, made, highest_mN)
    program = track_program(made, paths, STARTS_UM, most_mN(rig), homes)
    values |= {
        "force_mN": force_mN,
        "force": None if request.force is None else request.force.model_dump(),
        "place": None if request.place is None else request.place.model_dump(),
    }
    return pair_job(request, model, program, values, PAIR_POINTERS, present)


def evaluate(run: Run) -> Evaluation:
    """Compute the results of a tracked path."""
    if run.rig.second is not None:
        return pairs.evaluate(run)
    table, path, period_s = run.table, run.planned.path, run.period_s
    if path is None:
        raise ValueError("the motion program of the track has no path")
    full = full_amplitude(run, [path])
    force_r = series(table, "force_r_mN")
    x_pp_um = figures.peak_to_peak(series(table, "x_r_um"), full)
    force_pp_mN = figures.peak_to_peak(force_r, full)
    true_error = series(table, "true_force_mN") - force_r
    cycles = cycle_errors(table, path, period_s, full)
    learned, told = learned_of(run, path), None
    judged_cycles = path.cycles if learned is None else min(LEARNED_CYCLES, path.cycles)
    if learned is not None:
        held = judged(run, learned, cycles)
        told = learned_report(
            learned, learning_digest(run.planned.program, run.planned.armed.rig), held
        )
        learned = kept(learned) if held is not None and held.helps else None
    result = TrackResult(
        **common(run),
        shape=path.shape,
        x_pp_um=x_pp_um,
        force_pp_mN=force_pp_mN,
        tracked_samples=int(full.sum()),
        position_um=tracking(position_error(table), full, x_pp_um),
        force_mN=tracking(force_error(table), full, force_pp_mN),
        true_force_mN=tracking(true_error, full, force_pp_mN),
        force_uncertainty_mN=figures.mean(series(table, "force_uncertainty_mN"), full),
        zero_age_s=figures.last_of(table, "zero_age_s", within(table, ["track"])),
        cycles=cycles,
        learned=told,
        error_sources=sources_of(
            table,
            full_amplitude(run, [path], judged_cycles),
            run.planned.armed.rig,
            cycle_ticks=whole_cycle(path, period_s),
        ),
    )
    return Evaluation(result, learned=learned)


def learning(planned: Planned, path: Path, period_s: float) -> Planned:
    """Return the plan with a program that learns; raises FaultyRequestError if nothing repeats."""
    if path.knots:
        raise FaultyRequestError(
            "/learn", f"learn = true with a {path.shape}: only a sinusoid or a triangle has cycles"
        )
    try:
        ticks = cycle_ticks(path.cycle_s, period_s)
    except ValueError as error:
        raise FaultyRequestError("/frequency_hz", str(error)) from error
    program = changed(planned.program, corrections=no_corrections(ticks))
    return replace(planned, program=program)


def whole_cycle(path: Path, period_s: float) -> int:
    """Return the number of ticks of a cycle; 0 for a path without cycles, or if the number is not
    whole.
    """
    if path.knots:
        return 0
    try:
        return cycle_ticks(path.cycle_s, period_s)
    except ValueError:
        return 0


def learned_of(run: Run, path: Path) -> Corrections | None:
    """Return what the program has learned, from the samples as the controller received them."""
    begun = run.planned.program.corrections
    if begun is None:
        return None
    table, period_s = run.table, run.period_s
    learner, slack_s = CycleLearner(begun), 0.5 * period_s
    track = next(
        number for number, one in enumerate(run.planned.program.segments) if isinstance(one, Track)
    )
    before: tuple[int, bool] | None = None
    names = ("segment", "segment_tick", "paused", "limits_active", "x_um", "x_r_um")
    for segment, tick, paused, limits, x_um, x_r_um in zip(
        *(table[name] for name in names), strict=True
    ):
        if tick is None:
            continue
        # References and limits of a sample are those of the previous tick.
        if before is not None and x_um is not None:
            at_s = before[0] * period_s
            if path.full_from_s - slack_s <= at_s < path.full_to_s - slack_s:
                learner = learner.updated(before[0], x_um - x_r_um, limited=before[1])
        before = (tick, bool(paused) or bool(limits)) if segment == track else None
    return learner.corrections


def judged(run: Run, learned: Corrections, cycles: Sequence[CycleErrors]) -> HeldOut | None:
    """Compare cycles of this job that were not used for learning with a cycle without corrections.

    The reference is the first cycle of this job, or, if it began with earlier corrections, the
    first cycle of the first job.
    """
    begun = run.planned.program.corrections
    errors_um = [one.position_um for one in cycles if one.position_um is not None]
    if begun is None or not errors_um or not learned.errors_um:
        return None
    learned_um = errors_um if begun.errors_um else errors_um[1:]
    noise_um = NOISE_IN_ERROR * run.planned.armed.rig.sensor.noise_um
    ticks = len(learned.values_um)
    return held_out(learned.errors_um[0], learned_um, ticks=ticks, noise_um=noise_um)


def kept(learned: Corrections) -> Corrections:
    """Return the corrections with which the next job begins: those of the best cycle.

    The newest corrections have not been used in a cycle yet.
    """
    return changed(learned, values_um=learned.best_um or learned.values_um)


def learned_report(learned: Corrections, program: str, held: HeldOut | None) -> Learned:
    """Return the learned corrections as they are reported to users."""
    return Learned(
        program=program,
        cycles=len(learned.errors_um),
        largest_um=max(abs(value) for value in learned.values_um),
        over=learned.over,
        errors_um=list(learned.errors_um),
        kept=held is not None and held.helps,
        before_um=None if held is None else held.before_um,
        after_um=None if held is None else held.after_um,
    )


def cycle_errors(table: Columns, path: Path, period_s: float, full: Mask) -> list[CycleErrors]:
    """Return the r.m.s. errors of each cycle at full amplitude; empty for a path without cycles."""
    if path.knots:
        return []
    t_s = (series(table, "segment_tick") - 1.0) * period_s - path.full_from_s
    number = np.floor(t_s / path.cycle_s + 1e-6)
    errors = (
        position_error(table),
        force_error(table),
        series(table, "true_force_mN") - series(table, "force_r_mN"),
    )
    return [_cycle(full & (number == cycle), errors) for cycle in range(path.cycles)]


def _cycle(samples: Mask, errors: Sequence[Series]) -> CycleErrors:
    found = [_rms(error[samples]) for error in errors]
    return CycleErrors(position_um=found[0], force_mN=found[1], true_force_mN=found[2])


def _rms(error: Series) -> float | None:
    if not len(error) or np.isnan(error).any():
        return None
    return float(np.sqrt(np.mean(error**2)))


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot, pointer=contact_pointer)
