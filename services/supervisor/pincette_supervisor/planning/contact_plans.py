"""What plans of jobs that meet a part have in common: values of the contact, law, steady errors."""

from dataclasses import asdict
from typing import Any

from msgspec.structs import replace
from pydantic import BaseModel

from pincette.api.job_kinds import job_kinds
from pincette.api.plans import Plan, PlannedPhase, SteadyErrors
from pincette.api.predictions import Violation
from pincette.api.requests import ContactJobRequest
from pincette.config import RigFile, derived
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.steady import steady_error_ranges
from pincette.control.planning.conditioning import PHASE
from pincette.control.planning.contact_plan import ContactPlan
from pincette.control.planning.feasibility import Violation as Broken
from pincette.control.planning.sampling import unsampled
from pincette_supervisor.model.model_in_use import ModelInUse
from pincette_supervisor.planning.errors import FaultyRequestError
from pincette_supervisor.planning.laws import choose_law
from pincette_supervisor.planning.planned import Planned, decimated
from pincette_supervisor.planning.present import Present
from pincette_supervisor.results.goal import goal_warnings, tolerances

CONTACT_FIELDS = ("load_s", "approach_um_per_s", "seek_um_per_s", "contact_force_mN")


def contact_values(request: BaseModel, names: tuple[str, ...], rig: RigFile) -> dict[str, Any]:
    """Members of a request by their names, those left out as the rig file's grip has them."""
    return {
        name: given if (given := getattr(request, name)) is not None else getattr(rig.grip, name)
        for name in names
    }


def conditioning_V(request: ContactJobRequest, rig: RigFile, present: Present) -> float | None:
    """Return the lowest voltage of the conditioning strokes of a plan; None: it has none.

    Raises
    ------
    FaultyRequestError
        Where the request asks for strokes that the model in use does not allow.
    """
    low_V, condition = derived.conditioning_V(rig), request.condition or rig.grip.condition
    if condition == "always" and low_V is None:
        raise FaultyRequestError(
            "/condition",
            'condition = "always" needs a free response that was identified down to a voltage '
            "below 0 V, and the model in use is not: calibrate free_response with voltage_min_V "
            'below 0, or ask for condition = "never"',
        )
    wanted = condition == "always" or (condition == "auto" and present.memory_known is False)
    return low_V if wanted else None


def unconditioned(made: ContactPlan, present: Present) -> list[str]:
    """Return a warning where the arm's past is not known and the plan has no strokes."""
    if present.memory_known is not False or made.program.segments[0].phase == PHASE:
        return []
    return [
        "the arm's past is not known and no conditioning strokes come first: the force may be "
        "off by what the uncertainty says, some mN at the most"
    ]


def part_values(rig: RigFile) -> dict[str, Any]:
    """What the rig file says of the contact."""
    part = rig.part
    return {
        "zero_s": rig.grip.zero_s,
        "contact_um": part.contact_um,
        "contact_tolerance_um": part.contact_tolerance_um,
        "stiffness_mN_per_um": part.stiffness_mN_per_um,
        "stiffness_tolerance": part.stiffness_tolerance,
    }


def violation_view(found: Broken) -> Violation:
    """A broken limit as REST has it."""
    return Violation.model_validate({**asdict(found), "side": found.side})


def contact_job(
    request: ContactJobRequest,
    model: ModelInUse,
    made: ContactPlan,
    forces_mN: tuple[float, float],
    values: dict[str, Any],
    present: Present | None = None,
) -> Planned:
    """Add the law to a plan; one whose loop is not stable enough is one more violation."""
    rig = model.rig
    law = choose_law(request, rig)
    violations = [violation_view(found) for found in made.violations]
    if not law.assessment.stable:
        violations.append(law.violation())
    plan = Plan(
        kind=request.kind,
        rig=rig.rig.name,
        feasible=not violations,
        duration_s=made.duration_s,
        phases=[planned_phase(asdict(phase)) for phase in made.phases],
        violations=violations,
        curves=decimated(made.course),
        steady_errors=_steady_errors(rig, law.settings, forces_mN),
        law=law.view(),
        warnings=[
            *unidentified(rig),
            *unconditioned(made, present or Present()),
            *unsampled(made.program.segments, rig.rig.period_s),
            *goal_warnings(tolerances(request), made.program, job_kinds()[request.kind].goal_phase),
        ],
    )
    program = replace(made.program, laws=(law.settings.spec(),), slip_retries=request.retries)
    values = {**values, **tolerances(request), "law": plan.law.model_dump()}
    return Planned(plan, program, values, model)


def unidentified(rig: RigFile) -> list[str]:
    """Say how far the force may be off where no calibration has found the free response."""
    arm = rig.model
    if arm.free_response is not None or arm.recorded_response is not None:
        return []
    error_mN = arm.hysteresis_fraction * abs(rig.part.contact_um) / arm.compliance_um_per_mN
    return [
        "no free response has been identified, a straight line is assumed: at first touch the "
        f"force may be off by {error_mN:.1f} mN (one standard uncertainty) and more, and the part "
        "seem softer or harder than it is; calibrate free_response first"
    ]


def contact_pointer(quantity: str, phase: str) -> str:
    """Member of a request that leads beyond a limit on the way to the part; empty: none does."""
    if phase == "contact" and quantity == "force":
        return "/contact_force_mN"
    if phase in ("open", "approach", "retreat") and quantity == "slew":
        return "/approach_um_per_s"
    return ""


def _steady_errors(rig: RigFile, law: LawSettings, forces_mN: tuple[float, float]) -> SteadyErrors:
    """Where the impedance would rest if the part differed within its tolerances."""
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


def planned_phase(values: dict[str, Any]) -> PlannedPhase:
    """A phase of a plan as it is sent."""
    return PlannedPhase(
        **{name: values[name] for name in values.keys() & PlannedPhase.model_fields}
    )
