"""From a request for a move, a hold or a release to its plan."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from pincette.api.motion_models import MotionPlan as PlanView
from pincette.api.motion_models import Pose
from pincette.api.motion_requests import (
    AnyMotionRequest,
    HoldJobRequest,
    MoveJobRequest,
    ReleaseJobRequest,
)
from pincette.api.plan_models import PlannedPhase
from pincette.api.violation_models import Violation
from pincette.config import RigFile, derived
from pincette.control.planning.motion_plan import (
    Cycles,
    MotionPlan,
    MoveRequest,
    Stand,
    plan_hold,
    plan_move,
    plan_release,
)
from pincette.control.planning.profiles import minimum_duration
from pincette_supervisor.model.model_in_use import ModelInUse
from pincette_supervisor.model.quantities import ASSUMED
from pincette_supervisor.planning.calibration_plans import GAIN_GROWTH, SPEED_FACTOR
from pincette_supervisor.planning.laws import rig_law
from pincette_supervisor.planning.path_requests import FaultyRequestError
from pincette_supervisor.planning.planned import Planned, thinned
from pincette_supervisor.planning.present import Present

Made = tuple[MotionPlan, dict[str, Any], list[str]]
"""A plan, the values it was made of, and what a person should know."""


def plan_motion(request: AnyMotionRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a motion from where the rig stands.

    Raises
    ------
    FaultyRequestError
        Where members of the request do not go together with the rig.
    ValueError
        Where the numbers make no plan.
    """
    rig = model.rig
    stand = Stand(present.stand_um(rig), present.stand_V(rig))
    made, values, warnings = _made(request, model, present, stand)
    law = rig_law(rig)
    leads = any(not segment.open_loop for segment in made.program.segments)
    violations = [Violation(**asdict(violation)) for violation in made.violations]
    if leads and not law.assessment.stable:
        violations.append(law.violation())
    plan = PlanView(
        kind=request.kind,
        rig=rig.rig.name,
        feasible=not violations,
        duration_s=made.duration_s,
        begins_at=Pose(x_um=present.x_um, voltage_V=present.voltage_V),
        phases=[
            PlannedPhase(**{name: getattr(phase, name) for name in PlannedPhase.model_fields})
            for phase in made.phases
        ],
        violations=violations,
        curves=thinned(made.course),
        law=law.view() if leads else None,
        warnings=[*_unknown(present, rig), *warnings],
    )
    # A stop is under the law even where the motion is not.
    program = replace(made.program, laws=(law.settings,))
    return Planned(plan, program, values, model)


def _unknown(present: Present, rig: RigFile) -> list[str]:
    if present.voltage_V is not None:
        return []
    return [
        f"nothing has been heard of the arm: it is taken to stand at {rig.safety.safe_V:g} V, "
        f"{present.stand_um(rig):g} µm"
    ]


def _made(request: AnyMotionRequest, model: ModelInUse, present: Present, stand: Stand) -> Made:
    match request:
        case MoveJobRequest():
            return _move(request, model, present, stand)
        case HoldJobRequest():
            return _hold(request, model.rig, present, stand)
        case ReleaseJobRequest():
            return _release(request, model.rig, present, stand)


def _move(request: MoveJobRequest, model: ModelInUse, present: Present, stand: Stand) -> Made:
    rig = model.rig
    to_um, by_um = request.to_um, request.by_um
    if by_um is not None:
        to_um = stand.x_um + by_um
    speed = request.speed_um_per_s or rig.grip.approach_um_per_s
    cycles = _cycles(request, rig)
    move = MoveRequest(
        speed_um_per_s=speed,
        contact_force_mN=rig.grip.contact_force_mN,
        to_um=to_um,
        to_V=request.to_V,
        by_V=request.by_V,
        zero_s=rig.grip.zero_s if request.zero else None,
        cycles=cycles,
    )
    made = plan_move(move, derived.planned_rig(rig), stand, _move_pointers(request))
    values: dict[str, Any] = {
        "to_um": to_um,
        "to_V": request.to_V,
        "by_V": request.by_V,
        "speed_um_per_s": speed,
        "zero_s": move.zero_s,
        "cycles": None if cycles is None else asdict(cycles),
        "teach": request.teach,
    }
    return made, values, _move_warnings(made, model, present, by_um)


def _move_warnings(
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


def _touch_um(rig: RigFile) -> float:
    """Position from which on the arm may touch the part of the rig file."""
    return rig.part.contact_um - rig.part.contact_tolerance_um


def _cycles(request: MoveJobRequest, rig: RigFile) -> Cycles | None:
    """Cycles of the request over what it names, else as far as limits and the part allow."""
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


def _move_pointers(request: MoveJobRequest) -> Mapping[str, str]:
    target = next(f"/{name}" for name in ("to_um", "by_um", "to_V", "by_V") if _said(request, name))
    cycled = (
        "/high_V" if request.high_V is not None else "/low_V" if _said(request, "low_V") else ""
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


def _said(request: MoveJobRequest, name: str) -> bool:
    return getattr(request, name) is not None


def _hold(request: HoldJobRequest, rig: RigFile, present: Present, stand: Stand) -> Made:
    release_s = request.release_s or _release_s(rig, present)
    planned_rig, safe_V = derived.planned_rig(rig), rig.safety.safe_V
    pointers = {"unload slew": "/release_s"}
    made = plan_hold(request.hold_s, release_s, planned_rig, stand, safe_V, pointers)
    values = {"hold_s": request.hold_s, "release_s": release_s, "safe_V": safe_V}
    return made, values, _held_warnings(present)


def _release(request: ReleaseJobRequest, rig: RigFile, present: Present, stand: Stand) -> Made:
    release_s = request.release_s or _release_s(rig, present)
    planned_rig, safe_V = derived.planned_rig(rig), rig.safety.safe_V
    made = plan_release(release_s, planned_rig, stand, safe_V, {"unload slew": "/release_s"})
    return made, {"release_s": release_s, "safe_V": safe_V}, _held_warnings(present)


def _release_s(rig: RigFile, present: Present) -> float:
    """As long as a grip unloads, or where the way is far as the slew limit allows."""
    limits, safe_V = rig.limits, rig.safety.safe_V
    way_V = max(limits.voltage_max_V - safe_V, safe_V - limits.voltage_min_V)
    if present.voltage_V is not None:
        way_V = abs(present.voltage_V - safe_V)
    return max(rig.grip.load_s, minimum_duration(way_V, limits.slew_V_per_s))


def _held_warnings(present: Present) -> list[str]:
    if present.held:
        return []
    known = "is not known" if present.held is None else "is not told by the rig"
    return [f"that a part is held {known}: the operator is taken at their word"]
