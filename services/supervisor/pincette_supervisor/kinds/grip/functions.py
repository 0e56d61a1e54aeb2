"""Plan, result and plot of a grip."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pincette.config import RigFile, derived
from pincette.control.arm.plant import DifferenceEquation
from pincette.control.force.estimation import uncertainty_of_mean
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette.records.columns import Columns
from pincette_supervisor.kinds import pairs
from pincette_supervisor.kinds.grip import GripJobRequest, GripResult
from pincette_supervisor.kinds.grip.pair import plan_pair
from pincette_supervisor.kinds.grip.profile import chosen_speeds
from pincette_supervisor.plugin import (
    Evaluation,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
    Run,
    drawing,
    figures,
)
from pincette_supervisor.plugin.drawing import Picture, Sheet
from pincette_supervisor.plugin.figures import (
    Mask,
    chosen,
    common,
    draw_sources,
    force_error,
    position_error,
    series,
    sources_of,
)
from pincette_supervisor.plugin.plans import (
    CONTACT_FIELDS,
    arm_touch,
    conditioning_V,
    contact_job,
    contact_pointer,
    contact_values,
    part_values,
    slowed,
)

PRESSING = ("load", "hold", "unload")


def plan(request: GripJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a grip with the arms of the rig."""
    rig = model.rig
    if rig.second is not None:
        return plan_pair(request, model, present)
    values = contact_values(request, ("force_mN", "hold_s", *CONTACT_FIELDS), rig)
    if request.until_released:
        values["hold_s"] = None
    part = part_values(rig)
    speeds = chosen_speeds(request, rig)
    if speeds is None:
        touch = arm_touch(rig, values["force_mN"], values["contact_force_mN"])
        values = slowed(values, request, touch)
    else:
        values |= speeds.values()
        part |= {"zero_s": rig.grip.quick.zero_s, "quick": True}
    low_V = conditioning_V(request, rig)
    planned = derived.planned_rig(rig, present.x_um, low_V, present.rest_um())
    made = plan_grip(GripRequest(**values, **part), planned)
    if speeds is not None:
        made = replace(made, violations=(*speeds.violations, *made.violations))
    values["profile"] = "gentle" if speeds is None else "quick"
    return contact_job(request, model, made, (0.0, values["force_mN"]), values, present)


def pointer(quantity: str, phase: str) -> str:
    """Member of a request that leads beyond a limit; empty where none can be named."""
    return "/force_mN" if phase in PRESSING else contact_pointer(quantity, phase)


def evaluate(run: Run) -> Evaluation:
    """Work out the figures of a grip."""
    if run.rig.second is not None:
        return pairs.evaluate(run)
    result = grip_result(
        run.table,
        plant=run.plant,
        period_s=run.period_s,
        target_mN=run.planned.values["force_mN"],
        dropped=run.dropped,
        force_assumed=run.force_assumed,
    )
    hold, rig = _settled_hold(run.table["phase"], run.period_s), run.planned.armed.rig
    found = {
        "error_sources": sources_of(run.table, hold, rig),
        "force_uncertainty_mN": held_uncertainty_mN(run.table, rig, run.period_s),
    }
    return Evaluation(result.model_copy(update=found))


def held_uncertainty_mN(table: Columns, rig: RigFile, period_s: float) -> float | None:
    """Uncertainty of the force held, which is a mean over the settled hold; None without one."""
    hold = _settled_hold(table["phase"], period_s)
    stated_mN = chosen(series(table, "force_uncertainty_mN"), hold)
    if not stated_mN.size:
        return None
    reading_mN = rig.sensor.noise_um / rig.model.compliance_um_per_mN
    noise_mN = reading_mN * derived.force_observer(rig).noise_gain
    return uncertainty_of_mean(stated_mN.tolist(), noise_mN=noise_mN, reading_mN=reading_mN)


def grip_result(
    table: Columns,
    *,
    plant: DifferenceEquation,
    period_s: float,
    target_mN: float,
    dropped: int,
    force_assumed: Sequence[str] = (),
) -> GripResult:
    """Figures of a grip; ``plant`` is the arm as the law's parameter set has it."""
    hold = _settled_hold(table["phase"], period_s)
    force, error_mN = series(table, "force_mN"), force_error(table)
    return GripResult(
        **common(
            table,
            plant=plant,
            period_s=period_s,
            dropped=dropped,
            force_assumed=force_assumed,
        ),
        force_target_mN=target_mN,
        force_held_mN=figures.mean(force, hold),
        force_error_mN=figures.mean(error_mN, hold),
        force_uncertainty_mN=figures.mean(series(table, "force_uncertainty_mN"), hold),
        zero_age_s=figures.last_of(table, "zero_age_s", hold),
        rmse_position_um=figures.rms(position_error(table), hold),
        rmse_force_mN=figures.rms(error_mN, hold),
        true_force_held_mN=figures.mean(series(table, "true_force_mN"), hold),
    )


def _settled_hold(phase: Sequence[str | None], period_s: float) -> Mask:
    return figures.settled(np.array([name == "hold" for name in phase], dtype=np.bool_), period_s)


def plot(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Draw position, force, their errors and voltage over one time."""
    table, result = run.table, evaluation.result
    if not isinstance(result, GripResult):
        return pairs.plot(run, evaluation, name)
    sheet = Sheet()
    drawing.contact_over_time(sheet, table, result, run.period_s, run.planned.values)
    if result.error_sources is not None:
        # Below the axis of time, which is moved up for it.
        sheet.figure.subplots_adjust(bottom=0.18)
        causes = sheet.figure.add_axes((0.085, 0.025, 0.9, 0.075))
        draw_sources(causes, result.error_sources)
    sheet.head(0.085, _title(result), _subtitle(result), name)
    return sheet.picture()


def _title(result: GripResult) -> str:
    outcome = result.outcome.replace("_", " ")
    if result.force_held_mN is None:
        return f"{outcome}: no force was held"
    spread = "" if result.force_uncertainty_mN is None else f" ± {result.force_uncertainty_mN:.2f}"
    return f"{outcome}: {result.force_held_mN:.2f}{spread} mN held"


def _subtitle(result: GripResult) -> str:
    words = [f"asked for {result.force_target_mN:g} mN", *drawing.contact_words(result)]
    if result.peak_force_mN is not None:
        words.append(f"peak {result.peak_force_mN:.2f} mN")
    if result.true_force_held_mN is not None:
        words.append(f"true force held {result.true_force_held_mN:.2f} mN")
    return "   ·   ".join(words)


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot, pointer=pointer)
