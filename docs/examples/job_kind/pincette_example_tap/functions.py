"""Plan, result and plot of a tap."""

from pincette.config import derived
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette_example_tap import TapRequest, TapResult
from pincette_supervisor.plugin import (
    Evaluation,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
    Run,
    drawing,
)
from pincette_supervisor.plugin.figures import series, within
from pincette_supervisor.plugin.plans import (
    CONTACT_FIELDS,
    contact_job,
    contact_values,
    part_values,
)
from pincette_supervisor.plugin.result import common

HOLD_S = 0.2


def plan(request: TapRequest, model: ModelInUse, _present: Present) -> Planned:
    """Plan a grip that is released at once."""
    rig = model.rig
    values = {"force_mN": request.force_mN, "hold_s": HOLD_S}
    values |= contact_values(request, CONTACT_FIELDS, rig)
    made = plan_grip(GripRequest(**values, **part_values(rig)), derived.planned_rig(rig))
    return contact_job(request, model, made, (0.0, request.force_mN), values)


def evaluate(run: Run) -> Evaluation:
    """Return the contact from the values that every job with a part has."""
    found = common(run)
    return Evaluation(TapResult(**{name: found[name] for name in TapResult.model_fields}))


def plot(run: Run, evaluation: Evaluation, name: str) -> bytes:
    """Draw the force over the position while the part is loaded."""
    sheet, load = drawing.Sheet(), within(run.table, ["load"])
    (axis,) = drawing.grid(sheet, 1)
    drawing.prepare(axis, "force / mN", "position / µm")
    x_um, force_mN = series(run.table, "x_um")[load], series(run.table, "force_mN")[load]
    drawing.line(axis, x_um, force_mN, drawing.MEASURED, "estimated")
    drawing.legend(axis)
    sheet.head(drawing.LEFT, "tap", evaluation.result.outcome, name)
    return sheet.png()


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot)
