"""Plan, result and plot of a move."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from pincette.config import RigFile, derived
from pincette.control.planning.contact_plan import MotionPlan
from pincette.control.planning.motion_plan import REST_S, Cycles, MoveRequest, plan_move
from pincette_supervisor.kinds.motions import evaluate, plot
from pincette_supervisor.kinds.move import TARGETS, MoveJobRequest
from pincette_supervisor.plugin import (
    ASSUMED,
    FaultyRequestError,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
)
from pincette_supervisor.plugin.goal import goal_warnings, planned_goal, tolerances
from pincette_supervisor.plugin.plans import GAIN_GROWTH, SPEED_FACTOR, motion_job, stand_of

JUDGED_S = 0.2
"""Time of the rest after the settling time, over which a goal is judged."""
WARM_UP_EXCESS = 1.5
"""Factor by which a warm-up may exceed the requested time without a warning."""


def plan(request: MoveJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a move from where the arm stands."""
    rig, stand = model.rig, stand_of(present, model.rig)
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
        warnings.append("the position is not known: the arm goes to a place, not by a distance")
    if present.held:
        warnings.append("a part is held: a move lets it go")
    touch_um = _touch_um(rig)
    if max(made.course.x_r_um) > touch_um:
        warnings.append(
            f"from {touch_um:g} µm on the arm may touch the part of the rig file; the motion ends "
            "there only where the force has been zeroed"
        )
    quantity = "model.piezo_um_per_V"
    if model.calibration.sources.get(quantity, ASSUMED) == ASSUMED:
        warnings.append(f"rests on {quantity}, which is assumed: calibrate it first")
    return warnings


def _overridden(request: MoveJobRequest, made: MotionPlan, rig: RigFile) -> list[str]:
    """Return a warning for each requested value that the output or whole cycles override."""
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
            f"warm_up_s = {request.warm_up_s:g} s: whole cycles at this rate take {cycled_s:.3g} s"
        )
    return found


def _touch_um(rig: RigFile) -> float:
    """Return the position from which on the arm may touch the part of the rig file."""
    return rig.part.contact_um - rig.part.contact_tolerance_um


def _cycles(request: MoveJobRequest, rig: RigFile) -> Cycles | None:
    """Return cycles of the request over what it names, else as far as limits and the part allow."""
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
            f"cycles from {low_V:g} V to {high_V:g} V: the lower is not below the higher",
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


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot)
