"""From a request to a plan: what is left out comes from the rig file."""

from dataclasses import asdict, dataclass, replace
from math import ceil
from typing import Any

from pincette.config import RigFile, derived
from pincette.control.laws.law import LawSettings
from pincette.control.laws.steady import steady_error_ranges
from pincette.control.planning.contact_plan import ContactPlan
from pincette.control.planning.course import Course
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette.control.planning.path_shapes import peaks
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette.control.planning.track_plan import TrackRequest, plan_track
from pincette_supervisor import plan_models
from pincette_supervisor.laws import ChosenLaw, choose_law
from pincette_supervisor.path_requests import path_values, requested_path
from pincette_supervisor.plan_models import Curves, Plan, PlannedPhase, Violation
from pincette_supervisor.request_models import AnyJobRequest, GripJobRequest, TrackJobRequest

CURVE_POINTS = 400
CONTACT_WISHES = ("load_s", "approach_um_per_s", "seek_um_per_s", "contact_force_mN")
GRIP_WISHES = ("force_mN", "hold_s", *CONTACT_WISHES)


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan for people, the program for the controller, and the values both rest on."""

    plan: Plan
    program: Program
    values: dict[str, Any]
    """As they are stored and sent."""

    @property
    def planned_s(self) -> float | None:
        """How long it takes; None where a hold has no end."""
        endless = any(segment.duration_s is None for segment in self.program.segments)
        return None if endless else self.plan.duration_s

    @property
    def path(self) -> Path | None:
        """The path that is tracked, where one is."""
        paths = (segment.path for segment in self.program.segments)
        return next((path for path in paths if path is not None), None)


def plan_job(request: AnyJobRequest, rig: RigFile) -> Planned:
    """Plan a job; limits it breaks are in ``plan.violations``.

    Raises
    ------
    FaultyRequestError
        Where members of the request do not go together.
    ValueError
        Where the numbers make no plan.
    """
    if isinstance(request, TrackJobRequest):
        return _plan_track(request, rig)
    return _plan_grip(request, rig)


def _plan_grip(request: GripJobRequest, rig: RigFile) -> Planned:
    values = _wishes(request, GRIP_WISHES, rig)
    if request.until_released:
        values["hold_s"] = None
    contact_plan = plan_grip(GripRequest(**values, **_part(rig)), derived.planned_rig(rig))
    return _planned(request, rig, contact_plan, (0.0, values["force_mN"]), values)


def _plan_track(request: TrackJobRequest, rig: RigFile) -> Planned:
    contact = _wishes(request, CONTACT_WISHES, rig)
    values = path_values(request, rig)
    path, pointer = requested_path(request, values, rig.part.stiffness_mN_per_um)
    track = TrackRequest(
        **contact,
        **_part(rig),
        path=path,
        rate_um_per_s=values["rate_um_per_s"],
        acceleration_um_per_s2=values["acceleration_um_per_s2"],
        pointer=pointer,
    )
    contact_plan = plan_track(track, derived.planned_rig(rig))
    found = peaks(path)
    forces_mN = (found.lowest, found.highest)
    return _planned(request, rig, contact_plan, forces_mN, {**values, **contact})


def _wishes(request: AnyJobRequest, names: tuple[str, ...], rig: RigFile) -> dict[str, Any]:
    return {
        name: wish if (wish := getattr(request, name)) is not None else getattr(rig.grip, name)
        for name in names
    }


def _part(rig: RigFile) -> dict[str, float]:
    """What the rig file says of the contact."""
    part = rig.part
    return {
        "zero_s": rig.grip.zero_s,
        "contact_um": part.contact_um,
        "contact_tolerance_um": part.contact_tolerance_um,
        "stiffness_mN_per_um": part.stiffness_mN_per_um,
        "stiffness_tolerance": part.stiffness_tolerance,
    }


def _planned(
    request: AnyJobRequest,
    rig: RigFile,
    planned: ContactPlan,
    forces_mN: tuple[float, float],
    values: dict[str, Any],
) -> Planned:
    """Add the law to a plan; one whose loop is not stable enough is one more violation."""
    law = choose_law(request, rig)
    violations = [Violation(**asdict(violation)) for violation in planned.violations]
    if not law.assessment.stable:
        violations.append(_unstable(law))
    plan = Plan(
        kind=request.kind,
        rig=rig.rig.name,
        feasible=not violations,
        duration_s=planned.duration_s,
        phases=[_phase(asdict(phase)) for phase in planned.phases],
        violations=violations,
        curves=_curves(planned.course),
        steady_errors=_steady_errors(rig, law.settings, forces_mN),
        law=law.view(),
    )
    program = replace(planned.program, laws=(law.settings,))
    return Planned(plan, program, {**values, "law": plan.law.model_dump()})


def _unstable(law: ChosenLaw) -> Violation:
    """The loop's spectral radius as a limit that the plan breaks before it begins."""
    judged = law.assessment
    return Violation(
        pointer="/gains",
        quantity="spectral radius",
        value=judged.radius,
        limit=judged.limit_radius,
        unit="",
        at_s=0.0,
        message=judged.reason,
    )


def _steady_errors(
    rig: RigFile, law: LawSettings, forces_mN: tuple[float, float]
) -> plan_models.SteadyErrors:
    """Where the impedance would rest if the part differed within its tolerances."""
    part = rig.part
    found = steady_error_ranges(
        forces_r_mN=forces_mN,
        x_e_um=part.contact_um,
        x_e_tolerance_um=part.contact_tolerance_um,
        K_e=part.stiffness_mN_per_um,
        K_e_tolerance=part.stiffness_tolerance,
        K=law.K,
        K_f=law.K_f,
    )
    return plan_models.SteadyErrors(**asdict(found))


def _phase(values: dict[str, Any]) -> PlannedPhase:
    return PlannedPhase(**{name: values[name] for name in PlannedPhase.model_fields})


def _curves(course: Course) -> Curves:
    stride = max(1, ceil((len(course.t_s) - 1) / CURVE_POINTS))
    return Curves(
        t_s=course.t_s[::stride],
        x_r_um=course.x_r_um[::stride],
        force_r_mN=course.force_r_mN[::stride],
        voltage_V=course.voltage_V[::stride],
    )
