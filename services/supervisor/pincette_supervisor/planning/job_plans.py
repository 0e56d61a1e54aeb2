"""From a request to a plan: what is left out comes from the rig file."""

from dataclasses import asdict, replace
from typing import Any

from pincette.api import plan_models
from pincette.api.calibration_requests import CalibrationRequest
from pincette.api.motion_requests import HoldJobRequest, MoveJobRequest, ReleaseJobRequest
from pincette.api.plan_models import Plan, PlannedPhase
from pincette.api.request_models import (
    AnyJobRequest,
    GripJobRequest,
    LawJobRequest,
    TrackJobRequest,
)
from pincette.api.violation_models import Violation
from pincette.config import RigFile, derived
from pincette.control.laws.law import LawSettings
from pincette.control.laws.steady import steady_error_ranges
from pincette.control.planning.contact_plan import ContactPlan
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette.control.planning.path_shapes import peaks
from pincette.control.planning.track_plan import TrackRequest, plan_track
from pincette_supervisor.model.model_in_use import ModelInUse, rig_file_alone
from pincette_supervisor.planning.calibration_plans import plan_calibration
from pincette_supervisor.planning.contact_values import CONTACT_WISHES, contact_wishes, part_values
from pincette_supervisor.planning.laws import choose_law
from pincette_supervisor.planning.motion_plans import plan_motion
from pincette_supervisor.planning.path_requests import path_values, requested_path
from pincette_supervisor.planning.planned import Planned, thinned
from pincette_supervisor.planning.present import Present

GRIP_WISHES = ("force_mN", "hold_s", *CONTACT_WISHES)


def plan_job(
    request: AnyJobRequest, rig: RigFile | ModelInUse, present: Present | None = None
) -> Planned:
    """Plan a job; limits it breaks are in ``plan.violations``.

    Parameters
    ----------
    rig
        The rig with the model in use, or the rig file alone.
    present
        Where it stands; None: nobody has told.

    Raises
    ------
    FaultyRequestError
        Where members of the request do not go together.
    UnsupportedError
        Where the instruments are too slow for a calibration.
    ValueError
        Where the numbers make no plan.
    """
    model = rig if isinstance(rig, ModelInUse) else rig_file_alone(rig)
    planned = _plan(request, model, present or Present())
    values = {**planned.values, "model": planned.model.stamp}
    return replace(planned, values=values, present=present)


def _plan(request: AnyJobRequest, model: ModelInUse, present: Present) -> Planned:
    if isinstance(request, CalibrationRequest):
        return plan_calibration(request, model)
    if isinstance(request, MoveJobRequest | HoldJobRequest | ReleaseJobRequest):
        return plan_motion(request, model, present)
    if isinstance(request, TrackJobRequest):
        return _plan_track(request, model)
    return _plan_grip(request, model)


def _plan_grip(request: GripJobRequest, model: ModelInUse) -> Planned:
    rig = model.rig
    values = contact_wishes(request, GRIP_WISHES, rig)
    if request.until_released:
        values["hold_s"] = None
    contact_plan = plan_grip(GripRequest(**values, **part_values(rig)), derived.planned_rig(rig))
    return _planned(request, model, contact_plan, (0.0, values["force_mN"]), values)


def _plan_track(request: TrackJobRequest, model: ModelInUse) -> Planned:
    rig = model.rig
    contact = contact_wishes(request, CONTACT_WISHES, rig)
    values = path_values(request, rig)
    path, pointer = requested_path(request, values, rig.part.stiffness_mN_per_um)
    track = TrackRequest(
        **contact,
        **part_values(rig),
        path=path,
        rate_um_per_s=values["rate_um_per_s"],
        acceleration_um_per_s2=values["acceleration_um_per_s2"],
        pointer=pointer,
    )
    contact_plan = plan_track(track, derived.planned_rig(rig))
    found = peaks(path)
    forces_mN = (found.lowest, found.highest)
    return _planned(request, model, contact_plan, forces_mN, {**values, **contact})


def _planned(
    request: LawJobRequest,
    model: ModelInUse,
    planned: ContactPlan,
    forces_mN: tuple[float, float],
    values: dict[str, Any],
) -> Planned:
    """Add the law to a plan; one whose loop is not stable enough is one more violation."""
    rig = model.rig
    law = choose_law(request, rig)
    violations = [Violation(**asdict(violation)) for violation in planned.violations]
    if not law.assessment.stable:
        violations.append(law.violation())
    plan = Plan(
        kind=request.kind,
        rig=rig.rig.name,
        feasible=not violations,
        duration_s=planned.duration_s,
        phases=[_phase(asdict(phase)) for phase in planned.phases],
        violations=violations,
        curves=thinned(planned.course),
        steady_errors=_steady_errors(rig, law.settings, forces_mN),
        law=law.view(),
    )
    program = replace(planned.program, laws=(law.settings,))
    return Planned(plan, program, {**values, "law": plan.law.model_dump()}, model)


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
