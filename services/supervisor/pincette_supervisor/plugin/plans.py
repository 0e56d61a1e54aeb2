"""Common parts of plans of one arm, with a part and in free air."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from msgspec.structs import replace
from pydantic import BaseModel

from pincette.api.job_kinds import job_kinds
from pincette.api.plans import MotionPlan as PlanView
from pincette.api.plans import Plan, PlannedGoal, PlannedPhase, Pose, SteadyErrors
from pincette.api.predictions import Violation
from pincette.api.requests import ContactJobRequest, JobRequest
from pincette.config import RigFile, derived
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.parameters import LawSpec
from pincette.control.laws.steady import steady_error_ranges
from pincette.control.laws.two_arm_law import LAW as TWO_ARMS
from pincette.control.planning.contact_plan import ContactPlan, MotionPlan, PlannedRig
from pincette.control.planning.feasibility import Violation as Broken
from pincette.control.planning.motion_plan import StartPosition
from pincette.control.planning.prediction import PlannedPhase as CoursePhase
from pincette.control.planning.profiles import minimum_duration
from pincette.control.planning.program import Program
from pincette.control.planning.sampling import unsampled
from pincette.control.planning.segments import Drive
from pincette.control.planning.touch_force import SafeTouch
from pincette.core.wording import fault_text
from pincette_supervisor.plugin import FaultyRequestError, Planned, Present, decimated
from pincette_supervisor.plugin.goal import (
    PAST_HIDES_MN,
    goal_warnings,
    planned_goal,
    tolerances,
)
from pincette_supervisor.plugin.laws import choose_law, rig_law, unstable
from pincette_supervisor.plugin.model_in_use import ModelInUse
from pincette_supervisor.plugin.stated_uncertainty import (
    hidden_by_past,
    past_uncertainty_mN,
    ring_term,
    ring_violation,
    ring_warning,
    uncertain_forces,
)

CONTACT_FIELDS = ("load_s", "approach_um_per_s", "seek_um_per_s", "contact_force_mN")


def contact_values(request: BaseModel, names: tuple[str, ...], rig: RigFile) -> dict[str, Any]:
    """Return members of a request by name; missing ones are taken from the rig file's grip."""
    return {
        name: given if (given := getattr(request, name)) is not None else getattr(rig.grip, name)
        for name in names
    }


def slowed(values: dict[str, Any], request: BaseModel, touch: SafeTouch) -> dict[str, Any]:
    """Return values with safe contact speeds where the request specifies none.

    A requested speed is kept; the plan rejects it if it is too high.
    """
    safe = {
        name: min(values[name], touch.limit(name))
        for name in ("approach_um_per_s", "seek_um_per_s")
        if getattr(request, name) is None
    }
    return {**values, **safe}


def arm_touch(rig: RigFile, force_mN: float, contact_force_mN: float) -> SafeTouch:
    """Return the limits of the contact speeds for a plan of one arm with this highest force."""
    part = rig.part
    return SafeTouch(
        force_mN,
        contact_force_mN,
        part.stiffness_mN_per_um * (1.0 + part.stiffness_tolerance),
        rig.model.compliance_um_per_mN,
        rig.rig.period_s,
    )


def conditioning_V(request: ContactJobRequest, rig: RigFile) -> float | None:
    """Return the lowest voltage of a plan's conditioning strokes, in V; None: it has none.

    ``auto`` makes strokes before each approach, not only after an unknown history. A model follows
    a known history, but its errors are larger after other motions than after the grips with which
    it was rehearsed. The strokes also compare the stroke of the arm with that of its calibration.

    Raises
    ------
    FaultyRequestError
        If the request specifies strokes that the model in use does not allow.
    """
    low_V, condition = derived.conditioning_V(rig), request.condition or rig.grip.condition
    if condition == "always" and low_V is None and rig.limits.voltage_min_V >= 0.0:
        raise FaultyRequestError(
            "/condition",
            f"limits.voltage_min_V = {rig.limits.voltage_min_V:g} V leaves no room for "
            "conditioning strokes below 0 V: this rig cannot be conditioned; use condition "
            '= "auto" or "never"',
        )
    if condition == "always" and low_V is None:
        raise FaultyRequestError(
            "/condition",
            'condition = "always" needs a free response identified down to a voltage below '
            "0 V, unlike that of the model in use: calibrate free_response with "
            'voltage_min_V below 0, or use condition = "never"',
        )
    return None if condition == "never" else low_V


def usual_conditioning_V(rig: RigFile) -> float | None:
    """Return the lowest voltage of conditioning strokes, in V, if a request has no ``condition``;
    None if the rig file's grip makes none.
    """
    return None if rig.grip.condition == "never" else derived.conditioning_V(rig)


def unconditioned(
    strokes: bool, rig: RigFile, present: Present, force_mN: float | None = None
) -> list[str]:
    """Return assumptions about an arm's strokes, or a warning if needed strokes are missing.

    ``force_mN`` is the highest force of the plan, for which the warning states the uncertainty.
    """
    if strokes:
        return [
            "the conditioning strokes assume that since the calibration the voltage has "
            "stayed within the limits and has reached the highest voltage of the "
            "calibration; after a first installation, or where another program has driven "
            "the arm, make a full stroke without the part first"
        ]
    if present.memory_known is not False:
        return []
    size = "a few mN at most"
    if force_mN is not None:
        size = f"±{past_uncertainty_mN(rig, force_mN):.2g} mN from the past alone"
    if rig.limits.voltage_min_V >= 0.0:
        return [
            "the arm's past is not known, and limits.voltage_min_V = "
            f"{rig.limits.voltage_min_V:g} V leaves no room for conditioning strokes below 0 "
            f"V: the error of the force may reach the stated uncertainty, {size}"
        ]
    return [
        "the arm's past is not known and no conditioning strokes are planned: the error of "
        f"the force may reach the stated uncertainty, {size}"
    ]


def part_values(rig: RigFile) -> dict[str, Any]:
    """Return the rig file's values of the contact."""
    part = rig.part
    return {
        "zero_s": rig.grip.zero_s,
        "contact_um": part.contact_um,
        "contact_tolerance_um": part.contact_tolerance_um,
        "stiffness_mN_per_um": part.stiffness_mN_per_um,
        "stiffness_tolerance": part.stiffness_tolerance,
    }


def violation_view(found: Broken) -> Violation:
    """Return a violation of a limit as the REST interface represents it."""
    return Violation.model_validate({**asdict(found), "side": found.side})


def contact_job(
    request: ContactJobRequest,
    model: ModelInUse,
    made: ContactPlan,
    forces_mN: tuple[float, float],
    values: dict[str, Any],
    present: Present | None = None,
    pointer: str = "/force_mN",
) -> Planned:
    """Add the law to a plan; a loop that is not stable enough is an additional violation.

    Parameters
    ----------
    forces_mN
        Lowest and highest force of the plan.
    pointer
        Member of the request that determines the highest force.
    """
    rig = model.rig
    law = choose_law(request, rig)
    conditioned = made.conditioned
    unsure = uncertain_forces(
        rig, values["contact_force_mN"], forces_mN[1], pointer, conditioned=conditioned
    )
    past_mN = 0.0
    if not conditioned and present is not None and present.memory_known is False:
        unsure = (*unsure, *hidden_by_past(rig, forces_mN[1], pointer))
        past_mN = past_uncertainty_mN(rig, forces_mN[1])
    violations = [violation_view(found) for found in (*unsure, *made.violations)]
    violations += unstable(law.assessment)
    phase, wanted = job_kinds()[request.kind].goal_phase, tolerances(request)
    if 0.0 < (request.force_tolerance_mN or 0.0) <= past_mN:
        wanted[PAST_HIDES_MN] = past_mN
    ring = ring_term(made, rig, phase, wanted.get("settling_s", 0.0))
    violations += ring_violation(ring, rig, request.force_tolerance_mN)
    plan = Plan(
        kind=request.kind,
        rig=rig.rig.name,
        feasible=not violations,
        duration_s=made.duration_s,
        phases=[planned_phase(phase) for phase in made.phases],
        violations=violations,
        curves=decimated(made.course),
        profile=values.get("profile"),
        steady_errors=_steady_errors(rig, law.settings, forces_mN),
        law=law.view(),
        warnings=[
            *unidentified(rig),
            *unconditioned(conditioned, rig, present or Present(), forces_mN[1]),
            *([] if present is None or present.stroke is None else [fault_text(present.stroke)]),
            *unsampled(made.program.segments, rig.rig.period_s),
            *ring_warning(ring, rig),
            *goal_warnings(wanted, made.program, phase, rig),
        ],
        goal=planned_goal(wanted, made.program, phase),
    )
    program = replace(made.program, laws=(law.settings.spec(),), slip_retries=request.retries)
    values = {**values, **wanted, "law": plan.law.model_dump()}
    return Planned(plan, program, values, model)


def unidentified(rig: RigFile) -> list[str]:
    """Return a warning that states the force error while the free response is not calibrated."""
    arm = rig.model
    if arm.free_response is not None or arm.recorded_response is not None:
        return []
    error_mN = arm.hysteresis_fraction * abs(rig.part.contact_um) / arm.compliance_um_per_mN
    return [
        "no free response has been identified, so a straight line is assumed: at the first "
        f"touch the error of the force may be {error_mN:.1f} mN (one standard uncertainty) "
        "or more, and the part may seem softer or harder than it is; calibrate "
        "free_response first"
    ]


def contact_pointer(quantity: str, phase: str) -> str:
    """Return the pointer to the member that causes an exceeded limit before contact; empty if no
    member does."""
    if phase == "contact" and quantity == "force":
        return "/contact_force_mN"
    if phase in ("open", "approach", "retreat") and quantity == "slew":
        return "/approach_um_per_s"
    return ""


def _steady_errors(rig: RigFile, law: LawSettings, forces_mN: tuple[float, float]) -> SteadyErrors:
    """Return the steady errors of the impedance law if the part differs within its tolerances."""
    part, impedance = rig.part, law.definition.impedance(law.gains)
    found = steady_error_ranges(
        forces_r_mN=forces_mN,
        x_e_um=part.contact_um,
        x_e_tolerance_um=part.contact_tolerance_um,
        K_e=part.stiffness_mN_per_um,
        K_e_tolerance=part.stiffness_tolerance,
        K=impedance.K,
        K_f=impedance.K_f,
    )
    return SteadyErrors(**asdict(found))


def planned_phase(phase: CoursePhase) -> PlannedPhase:
    """Return a phase of a plan in the form that is sent."""
    return PlannedPhase(**asdict(phase))


GAIN_GROWTH = 1.3
"""Assumed factor by which the gain over a wide stroke may exceed d_p, the gain at 2 V peak to peak.
It equals that of a loop with a width of 18.5 % of the stroke."""
SPEED_FACTOR = 3.0
"""Ratio of the highest speed of a free motion to the approach speed."""


def start_position(present: Present, rig: RigFile) -> StartPosition:
    """Return position and voltage at which a motion begins."""
    return StartPosition(present.stand_um(rig), present.stand_V(rig))


def motion_job(
    request: JobRequest,
    model: ModelInUse,
    present: Present,
    made: MotionPlan,
    values: dict[str, Any],
    warnings: list[str],
    *,
    meets_part: bool,
    goal: PlannedGoal | None = None,
) -> Planned:
    """Add the law to a motion; a loop that is not stable enough is an additional violation."""
    rig = model.rig
    law = rig_law(rig)
    leads = any(not segment.open_loop for segment in made.program.segments)
    violations = [violation_view(found) for found in made.violations]
    if leads:
        violations += unstable(law.assessment)
    plan = PlanView(
        kind=request.kind,
        rig=rig.rig.name,
        feasible=not violations,
        duration_s=made.duration_s,
        begins_at=Pose(x_um=present.x_um, voltage_V=present.voltage_V),
        phases=[planned_phase(phase) for phase in made.phases],
        violations=violations,
        curves=decimated(made.course),
        law=law.view() if leads else None,
        warnings=[
            *_unknown(present, rig),
            *unsampled(made.program.segments, rig.rig.period_s),
            *warnings,
        ],
        goal=goal,
    )
    # A stop uses the law even if the motion does not.
    program = replace(made.program, laws=(law.settings.spec(),))
    if rig.second is not None:
        program = _of_both(made.program)
    return Planned(plan, program, values, model, meets_part=meets_part)


def releasing_job(
    request: JobRequest,
    model: ModelInUse,
    present: Present,
    release_s: float | None,
    make: Callable[[float, PlannedRig, StartPosition, float, Mapping[str, str]], MotionPlan],
    values: dict[str, Any],
) -> Planned:
    """Plan a motion that begins with a part held and ends with its release at the safe voltage."""
    rig, safe_V = model.rig, model.rig.safety.safe_V
    release_s = release_s or release_duration_s(rig, present)
    pointers = {"unload slew": "/release_s"}
    made = make(release_s, derived.planned_rig(rig), start_position(present, rig), safe_V, pointers)
    values = {**values, "release_s": release_s, "safe_V": safe_V}
    warnings = held_warnings(present)
    return motion_job(request, model, present, made, values, warnings, meets_part=True)


def _of_both(program: Program) -> Program:
    """Return the same motion for the voltages of both arms, with the law of both arms."""
    segments = tuple(
        replace(one, courses=2 * one.courses) if isinstance(one, Drive) else one
        for one in program.segments
    )
    return replace(program, segments=segments, laws=(LawSpec(TWO_ARMS.name),))


def _unknown(present: Present, rig: RigFile) -> list[str]:
    if present.voltage_V is not None:
        return []
    return [
        f"the arm has not reported its position yet; assumed are {rig.safety.safe_V:g} V, "
        f"{present.stand_um(rig):g} µm"
    ]


def release_duration_s(rig: RigFile, present: Present) -> float:
    """Return the release time, in s: that of a grip's unload, or longer by the slew limit."""
    limits, safe_V = rig.limits, rig.safety.safe_V
    way_V = max(limits.voltage_max_V - safe_V, safe_V - limits.voltage_min_V)
    known = [each for each in (present.voltage_V, present.second_V) if each is not None]
    if len(known) == len(rig.arms):
        way_V = max(abs(voltage_V - safe_V) for voltage_V in known)
    return max(rig.grip.load_s, minimum_duration(way_V, limits.slew_V_per_s))


def held_warnings(present: Present) -> list[str]:
    """Return a warning if the rig does not report that a part is held."""
    if present.held:
        return []
    known = "is not known" if present.held is None else "is not known to the rig"
    return [f"that a part is held {known}: the statement of the operator is accepted"]
