"""Plans of a move and of a release, and result and plot of every motion."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from pincette.api.plans import Pose
from pincette.api.results import MotionResult
from pincette.config import RigFile, derived
from pincette.control.planning.contact_plan import MotionPlan, PlannedRig
from pincette.control.planning.motion_plan import (
    REST_S,
    Cycles,
    LettingGo,
    MoveRequest,
    StartPosition,
    plan_letting_go,
    plan_move,
    plan_release,
)
from pincette.control.planning.profiles import move_duration
from pincette.records.columns import Columns
from pincette_supervisor.kinds.motions import TARGETS, MoveJobRequest, ReleaseJobRequest
from pincette_supervisor.plugin import (
    ASSUMED,
    Evaluation,
    FaultyRequestError,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
    Run,
    drawing,
    figures,
)
from pincette_supervisor.plugin.drawing import Picture, Sheet
from pincette_supervisor.plugin.figures import Mask, series, within
from pincette_supervisor.plugin.goal import goal_warnings, planned_goal, tolerances
from pincette_supervisor.plugin.plans import (
    GAIN_GROWTH,
    SPEED_FACTOR,
    motion_job,
    release_duration_s,
    releasing_job,
    start_position,
)
from pincette_supervisor.plugin.release import release_of, sticking
from pincette_supervisor.plugin.result import common

STRATEGIES = {"dither_um": 1.0, "dither_hz": 5.0, "dither_s": 2.0, "wait_s": 10.0}
"""Default values of the strategies of a release."""
DITHER_SAMPLES = 5
"""Least number of samples in each cycle of a dither."""
LAST_REST_S = 0.3
"""Duration of the end of a motion over which its pose is averaged, in s."""


def evaluate(run: Run) -> Evaluation:
    """Compute the results of a motion."""
    table, period_s, values = run.table, run.period_s, run.planned.values
    ends, begins = _edge(table, period_s, last=True), _edge(table, period_s, last=False)
    x_um, to_um = figures.mean(series(table, "x_um"), ends), values.get("to_um")
    held, hold = [item for item in table["held"] if item is not None], within(table, ["hold"])
    zero_age_s = figures.last(table["zero_age_s"])
    # No contact line is followed, so these two values do not exist.
    shared = common(run)
    shared |= dict.fromkeys(("contact_rmse_position_um", "contact_rmse_force_mN"))
    spread_mN = figures.mean(series(table, "force_uncertainty_mN"), ends)
    result = MotionResult(
        **shared,
        force_uncertainty_mN=None if zero_age_s is None else spread_mN,
        zero_age_s=zero_age_s,
        begins_at=Pose(
            x_um=figures.mean(series(table, "x_um"), begins),
            voltage_V=figures.mean(series(table, "voltage_V"), begins),
        ),
        ends_at=Pose(x_um=x_um, voltage_V=figures.last(table["voltage_V"])),
        teach=values.get("teach"),
        target_um=to_um,
        target_error_um=None if to_um is None or x_um is None else x_um - to_um,
        drift_um=figures.peak_to_peak(series(table, "x_um"), hold),
        held_at_end=bool(held[-1]) if held else False,
    )
    return Evaluation(result)


def _edge(table: Columns, period_s: float, *, last: bool) -> Mask:
    """Return the mask of the first sample, or with ``last`` that of the samples of the last
    rest.
    """
    count = len(table["seq"])
    mask = np.zeros(count, dtype=np.bool_)
    if last:
        mask[max(0, count - round(LAST_REST_S / period_s)) :] = True
    else:
        mask[:1] = True
    return mask


def plot(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Draw position, contact force, their errors and voltage of a motion over common time."""
    result = evaluation.result
    assert isinstance(result, MotionResult)
    sheet = Sheet()
    drawing.contact_over_time(sheet, run.table, result, run.period_s, run.planned.values)
    sheet.head(0.085, _title(result), _subtitle(result), name)
    return sheet.picture()


def _title(result: MotionResult) -> str:
    outcome, pose = result.outcome.replace("_", " "), result.ends_at
    if pose.x_um is None or pose.voltage_V is None:
        return f"{outcome}: no position was measured"
    return f"{outcome}: at {pose.x_um:.2f} µm, {pose.voltage_V:.3f} V"


def _subtitle(result: MotionResult) -> str:
    words: list[str] = []
    if result.begins_at.x_um is not None:
        words.append(f"from {result.begins_at.x_um:.2f} µm")
    if result.target_um is not None:
        words.append(f"requested {result.target_um:g} µm")
    if result.target_error_um is not None:
        words.append(f"error {result.target_error_um:.3f} µm")
    if result.drift_um is not None:
        words.append(f"moved by {result.drift_um:.2f} µm while held")
    if result.held_at_end:
        words.append("a part is held")
    if result.teach is not None:
        words.append(f"pose {result.teach}")
    return "   ·   ".join(words)


JUDGED_S = 0.2
"""Duration, after the settling time, of the rest over which a goal is evaluated, in s."""
WARM_UP_EXCESS = 1.5
"""Largest ratio of the duration of a warm-up to the requested time without a warning."""


def move_job(request: MoveJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a move from the present position of the arm."""
    rig, stand = model.rig, start_position(present, model.rig)
    to_um, by_um = request.to_um, request.by_um
    if by_um is not None:
        to_um = (stand.x_um if present.pose_um is None else present.pose_um) + by_um
    speed = request.speed_um_per_s or rig.grip.approach_um_per_s
    cycles, asked = _cycles(request, rig), tolerances(request)
    move = MoveRequest(
        speed_um_per_s=speed,
        contact_force_mN=rig.grip.contact_force_mN,
        to_um=to_um,
        to_V=request.to_V,
        by_V=request.by_V,
        zero_s=rig.grip.zero_s if request.zero else None,
        cycles=cycles,
        rest_s=max(REST_S, JUDGED_S + asked.get("settling_s", 0.0)),
    )
    made = plan_move(move, derived.planned_rig(rig), stand, _pointers(request))
    values: dict[str, Any] = {
        "to_um": to_um,
        "to_V": request.to_V,
        "by_V": request.by_V,
        "speed_um_per_s": speed,
        "zero_s": move.zero_s,
        "cycles": None if cycles is None else asdict(cycles),
        "teach": request.teach,
        **asked,
    }
    warnings = [
        *_warnings(made, model, present, by_um),
        *_overridden(request, made, rig),
        *goal_warnings(asked, made.program, "rest", rig),
    ]
    goal = planned_goal(asked, made.program, "rest")
    return motion_job(request, model, present, made, values, warnings, meets_part=False, goal=goal)


def _warnings(
    made: MotionPlan, model: ModelInUse, present: Present, by_um: float | None
) -> list[str]:
    rig = model.rig
    warnings: list[str] = []
    if by_um is not None and present.x_um is None:
        warnings.append("the position is not known: give a target position instead of a distance")
    if present.held:
        warnings.append("a part is held: a move releases it")
    touch_um = _touch_um(rig)
    if max(made.course.x_r_um) > touch_um:
        warnings.append(
            f"from {touch_um:g} µm on the arm may touch the part of the rig file; the motion "
            "stops there only if the force has been zeroed"
        )
    quantity = "model.piezo_um_per_V"
    if model.calibration.sources.get(quantity, ASSUMED) == ASSUMED:
        warnings.append(f"depends on {quantity}, which is assumed: calibrate it first")
    return warnings


def _overridden(request: MoveJobRequest, made: MotionPlan, rig: RigFile) -> list[str]:
    """Return a warning for each requested value that is changed by the output or to get whole
    cycles."""
    found: list[str] = []
    step_V, d_p = rig.output.step_V, rig.model.piezo_um_per_V
    for name, way, step, unit in (
        ("by_V", request.by_V, step_V, "V"),
        ("by_um", request.by_um, step_V * d_p, "µm"),
    ):
        if way is not None and abs(way) < step:
            found.append(
                f"{name} = {way:g} {unit} is less than one step of the output, {step:g} {unit}: "
                "the arm moves by a whole step or not at all"
            )
    cycled_s = sum(
        phase.duration_s for phase in made.phases if phase.phase == "warm up" and phase.duration_s
    )
    if request.warm_up_s and cycled_s > WARM_UP_EXCESS * request.warm_up_s:
        found.append(
            f"warm_up_s = {request.warm_up_s:g} s: the whole cycles at this rate take "
            f"{cycled_s:.3g} s"
        )
    return found


def _touch_um(rig: RigFile) -> float:
    """Return the smallest position at which the arm may be in contact with the part of the rig
    file, in µm."""
    return rig.part.contact_um - rig.part.contact_tolerance_um


def _cycles(request: MoveJobRequest, rig: RigFile) -> Cycles | None:
    """Return the requested cycles; default voltages go as far as limits and part permit."""
    if not request.conditioning_cycles and not request.warm_up_s:
        return None
    limits, d_p, safe_V = rig.limits, rig.model.piezo_um_per_V, rig.safety.safe_V
    low_V, high_V, rate = request.low_V, request.high_V, request.rate_V_per_s
    if low_V is None:
        low_V = max(limits.voltage_min_V, safe_V + limits.position_min_um / (GAIN_GROWTH * d_p))
    if high_V is None:
        highest_um = min(limits.position_max_um, _touch_um(rig))
        high_V = min(limits.voltage_max_V, safe_V + highest_um / (GAIN_GROWTH * d_p))
    if low_V >= high_V:
        raise FaultyRequestError(
            "/low_V" if request.low_V is not None else "/high_V",
            f"cycles from {low_V:g} V to {high_V:g} V: the first must be below the second",
        )
    return Cycles(
        low_V=low_V,
        high_V=high_V,
        rate_V_per_s=rate or SPEED_FACTOR * rig.grip.approach_um_per_s / d_p,
        count=request.conditioning_cycles,
        warm_up_s=request.warm_up_s,
    )


def _pointers(request: MoveJobRequest) -> Mapping[str, str]:
    target = next(f"/{name}" for name in TARGETS if _given(request, name))
    cycled = (
        "/high_V" if request.high_V is not None else "/low_V" if _given(request, "low_V") else ""
    )
    return {
        "move": target,
        "rest": target,
        "move slew": "/speed_um_per_s",
        "move acceleration": "/speed_um_per_s",
        "warm up": cycled,
        "condition": cycled,
        "warm up slew": "/rate_V_per_s",
        "condition slew": "/rate_V_per_s",
    }


def _given(request: MoveJobRequest, name: str) -> bool:
    return getattr(request, name) is not None


MOVE = JobFunctions(plan=move_job, evaluate=evaluate, plot=plot)


def release_job(request: ReleaseJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a release from the present state of the rig."""
    if request.strategies is None:
        return releasing_job(request, model, present, request.release_s, plan_release, {})
    rig, safe_V = model.rig, model.rig.safety.safe_V
    wanted = {name: getattr(request, name) or value for name, value in STRATEGIES.items()}
    most_hz = 1.0 / (DITHER_SAMPLES * rig.rig.period_s)
    if "dither" in request.strategies and wanted["dither_hz"] > most_hz:
        raise FaultyRequestError(
            "/dither_hz",
            f"dither_hz = {wanted['dither_hz']:g} Hz: each cycle needs {DITHER_SAMPLES} samples; "
            f"give at most {most_hz:g} Hz",
        )
    way_um = rig.model.piezo_um_per_V * abs(present.stand_V(rig) - safe_V)
    slow_s = move_duration(way_um, rig.grip.approach_um_per_s)
    release_s = request.release_s or max(slow_s, release_duration_s(rig, present))
    check_um = derived.check_way_um(rig)
    checks = tuple(derived.free_arm(arm, check_um) for arm in rig.arms)
    if safe_V - check_um / rig.model.piezo_um_per_V >= rig.limits.voltage_min_V:
        check_um = -check_um

    def make(
        release_s: float,
        planned: PlannedRig,
        stand: StartPosition,
        safe_V: float,
        at: Mapping[str, str],
    ) -> MotionPlan:
        letting_go = LettingGo(
            strategies=tuple(request.strategies or ()),
            release_s=release_s,
            check_um=check_um,
            checks=checks,
            **wanted,
        )
        return plan_letting_go(letting_go, planned, stand, safe_V, {**at, "dither": "/dither_um"})

    values = {"strategies": request.strategies, **wanted}
    return releasing_job(request, model, present, release_s, make, values)


def evaluate_release(run: Run) -> Evaluation:
    """Compute the results of a release; the release has failed if the part sticks."""
    return replace(evaluate(run), fault=sticking(release_of(run)))


RELEASE = JobFunctions(plan=release_job, evaluate=evaluate_release, plot=plot)
