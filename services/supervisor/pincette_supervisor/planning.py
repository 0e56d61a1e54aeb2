"""From a request to a plan: what is left out comes from the rig file."""

from dataclasses import asdict, dataclass
from math import ceil
from typing import Any

from pincette.config import RigFile
from pincette.control.course import PlanLimits
from pincette.control.grip_plan import GripPlan, GripRequest, plan_grip, sample_plan
from pincette.control.program import Program
from pincette_supervisor.models import (
    Curves,
    GripJobRequest,
    Plan,
    PlannedPhase,
    Violation,
)

CURVE_POINTS = 400
WISHES = (
    "force_mN",
    "hold_s",
    "load_s",
    "approach_um_per_s",
    "seek_um_per_s",
    "contact_force_mN",
)
X_START_UM = 0.0
"""Where the arm rests at zero voltage: the rig file's sensor offset makes it so."""


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan for people, the program for the controller, and the values both rest on."""

    plan: Plan
    program: Program
    values: dict[str, Any]


def plan_job(request: GripJobRequest, rig: RigFile) -> Planned:
    """Plan a grip; limits it breaks are in ``plan.violations``."""
    values: dict[str, Any] = {
        name: wish if (wish := getattr(request, name)) is not None else getattr(rig.grip, name)
        for name in WISHES
    }
    if request.until_released:
        values["hold_s"] = None
    part, limits, model = rig.part, rig.limits, rig.model
    grip = GripRequest(
        **values,
        zero_s=rig.grip.zero_s,
        contact_um=part.contact_um,
        contact_tolerance_um=part.contact_tolerance_um,
        stiffness_mN_per_um=part.stiffness_mN_per_um,
        stiffness_tolerance=part.stiffness_tolerance,
    )
    planned = plan_grip(
        grip,
        PlanLimits(
            voltage_min_V=limits.voltage_min_V,
            voltage_max_V=limits.voltage_max_V,
            position_min_um=limits.position_min_um,
            position_max_um=limits.position_max_um,
            force_max_mN=limits.force_max_mN,
        ),
        x_start_um=X_START_UM,
        piezo_um_per_V=model.piezo_um_per_V,
        compliance_um_per_mN=model.compliance_um_per_mN,
        period_s=rig.rig.period_s,
    )
    plan = Plan(
        kind="grip",
        rig=rig.rig.name,
        feasible=not planned.violations,
        duration_s=planned.duration_s,
        phases=[_phase(asdict(phase)) for phase in planned.phases],
        violations=[Violation(**asdict(violation)) for violation in planned.violations],
        curves=_curves(planned, rig.rig.period_s),
    )
    return Planned(plan, planned.program, values)


def _phase(values: dict[str, Any]) -> PlannedPhase:
    return PlannedPhase(**{name: values[name] for name in PlannedPhase.model_fields})


def _curves(plan: GripPlan, period_s: float) -> Curves:
    stride = max(1, ceil(plan.duration_s / period_s / CURVE_POINTS))
    samples = sample_plan(plan, stride * period_s)
    return Curves(
        t_s=samples.t_s,
        x_r_um=samples.x_r_um,
        force_r_mN=samples.force_r_mN,
        voltage_V=samples.voltage_V,
    )
