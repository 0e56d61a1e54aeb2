"""What plans of motions have in common: where they begin, their law, what a person should know."""

from collections.abc import Callable, Mapping
from typing import Any

from msgspec.structs import replace

from pincette.api.plans import MotionPlan as PlanView
from pincette.api.plans import PlannedGoal, Pose
from pincette.api.requests import JobRequest
from pincette.config import RigFile, derived
from pincette.control.laws.parameters import LawSpec
from pincette.control.laws.two_arm_law import LAW as TWO_ARMS
from pincette.control.planning.contact_plan import MotionPlan, PlannedRig
from pincette.control.planning.motion_plan import Stand
from pincette.control.planning.profiles import minimum_duration
from pincette.control.planning.program import Program
from pincette.control.planning.sampling import unsampled
from pincette.control.planning.segments import Drive
from pincette_supervisor.plugin.contact_plans import planned_phase, violation_view
from pincette_supervisor.plugin.laws import rig_law
from pincette_supervisor.plugin.model_in_use import ModelInUse
from pincette_supervisor.plugin.planned import Planned, decimated
from pincette_supervisor.plugin.present import Present

GAIN_GROWTH = 1.3
"""By which the gain over a wide stroke may exceed d_p, that at 2 V peak to peak; assumed, and that
of a loop of 18.5 % of the stroke."""
SPEED_FACTOR = 3.0
"""Fastest part of a free motion against the approach."""


def stand_of(present: Present, rig: RigFile) -> Stand:
    """Where a motion begins."""
    return Stand(present.stand_um(rig), present.stand_V(rig))


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
    """Add the law to a motion; one whose loop is not stable enough is one more violation."""
    rig = model.rig
    law = rig_law(rig)
    leads = any(not segment.open_loop for segment in made.program.segments)
    violations = [violation_view(found) for found in made.violations]
    if leads and not law.assessment.stable:
        violations.append(law.violation())
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
    # A stop is under the law even where the motion is not.
    program = replace(made.program, laws=(law.settings.spec(),))
    if rig.second is not None:
        program = _of_both(made.program)
    return Planned(plan, program, values, model, meets_part=meets_part)


def releasing_job(
    request: JobRequest,
    model: ModelInUse,
    present: Present,
    release_s: float | None,
    make: Callable[[float, PlannedRig, Stand, float, Mapping[str, str]], MotionPlan],
    values: dict[str, Any],
) -> Planned:
    """Plan a motion that begins with a part held and ends with its release at the safe voltage."""
    rig, safe_V = model.rig, model.rig.safety.safe_V
    release_s = release_s or _release_duration_s(rig, present)
    pointers = {"unload slew": "/release_s"}
    made = make(release_s, derived.planned_rig(rig), stand_of(present, rig), safe_V, pointers)
    values = {**values, "release_s": release_s, "safe_V": safe_V}
    warnings = _held_warnings(present)
    return motion_job(request, model, present, made, values, warnings, meets_part=True)


def _of_both(program: Program) -> Program:
    """The same motion of the voltages of both arms, with the law of both."""
    segments = tuple(
        replace(one, courses=2 * one.courses) if isinstance(one, Drive) else one
        for one in program.segments
    )
    return replace(program, segments=segments, laws=(LawSpec(TWO_ARMS.name),))


def _unknown(present: Present, rig: RigFile) -> list[str]:
    if present.voltage_V is not None:
        return []
    return [
        f"nothing has been heard of the arm: it is taken to stand at {rig.safety.safe_V:g} V, "
        f"{present.stand_um(rig):g} µm"
    ]


def _release_duration_s(rig: RigFile, present: Present) -> float:
    """As long as a grip unloads, or where the way is far as the slew limit allows."""
    limits, safe_V = rig.limits, rig.safety.safe_V
    way_V = max(limits.voltage_max_V - safe_V, safe_V - limits.voltage_min_V)
    known = [each for each in (present.voltage_V, present.second_V) if each is not None]
    if len(known) == len(rig.arms):
        way_V = max(abs(voltage_V - safe_V) for voltage_V in known)
    return max(rig.grip.load_s, minimum_duration(way_V, limits.slew_V_per_s))


def _held_warnings(present: Present) -> list[str]:
    """What a person should know where the rig does not say that a part is held."""
    if present.held:
        return []
    known = "is not known" if present.held is None else "is not told by the rig"
    return [f"that a part is held {known}: the operator is taken at their word"]
