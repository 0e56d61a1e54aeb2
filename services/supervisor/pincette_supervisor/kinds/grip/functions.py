"""Plan, result and plot of a grip."""

from dataclasses import replace
from typing import Any

from pincette.config import RigFile, derived
from pincette.control.force.estimation import uncertainty_of_mean
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette.control.planning.pair_plan import PairHold, grip_program
from pincette.control.planning.quick_grip import (
    AskedSpeeds,
    QuickSpeeds,
    UsualSpeeds,
    quick_speeds,
)
from pincette.control.planning.touch_force import weak_force
from pincette.records.columns import Columns
from pincette_supervisor.kinds import pairs
from pincette_supervisor.kinds.grip import GripJobRequest, GripResult
from pincette_supervisor.plugin import (
    Evaluation,
    FaultyRequestError,
    JobFunctions,
    ModelInUse,
    Planned,
    Present,
    Run,
    drawing,
    figures,
)
from pincette_supervisor.plugin.drawing import Picture, Sheet
from pincette_supervisor.plugin.error_sources import draw_sources, sources_of
from pincette_supervisor.plugin.figures import Mask, chosen, series, settled, within
from pincette_supervisor.plugin.pair_plans import (
    STARTS_UM,
    homes_um,
    most_mN,
    pair_job,
    pair_request,
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
from pincette_supervisor.plugin.result import common, force_error, position_error

PRESSING = ("load", "hold", "unload")
PAIR_POINTERS = {**dict.fromkeys(PRESSING, "/force_mN"), "carry": "/place_um"}
GENTLY = 'or grip with profile = "gentle"'


def plan(request: GripJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a grip with the arms of the rig."""
    rig = model.rig
    values = contact_values(request, ("force_mN", "hold_s", *CONTACT_FIELDS), rig)
    if request.until_released:
        values["hold_s"] = None
    if rig.second is not None:
        return _plan_pair(request, model, values, present)
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


def _plan_pair(
    request: GripJobRequest, model: ModelInUse, values: dict[str, Any], present: Present
) -> Planned:
    """Plan a grip with both arms."""
    rig, force_mN = model.rig, values["force_mN"]
    hold = PairHold(
        hold_s=values["hold_s"],
        place_to_um=request.place_um,
        carry_um_per_s=values["approach_um_per_s"],
    )
    made = pair_request(values, rig, force_mN, centred=request.centre)
    homes = homes_um(rig, made, force_mN)
    program = grip_program(made, hold, STARTS_UM, most_mN(rig), homes)
    values = {**values, "place_um": request.place_um}
    return pair_job(request, model, program, values, PAIR_POINTERS, present)


def pointer(quantity: str, phase: str) -> str:
    """Return the request member that causes an exceeded limit; empty if none can be named."""
    return "/force_mN" if phase in PRESSING else contact_pointer(quantity, phase)


def evaluate(run: Run) -> Evaluation:
    """Compute the results of a grip."""
    if run.rig.second is not None:
        return pairs.evaluate(run)
    table, rig = run.table, run.planned.armed.rig
    hold = settled(within(table, ["hold"]), run.period_s)
    error_mN = force_error(table)
    result = GripResult(
        **common(run),
        force_target_mN=run.planned.values["force_mN"],
        force_held_mN=figures.mean(series(table, "force_mN"), hold),
        force_error_mN=figures.mean(error_mN, hold),
        force_uncertainty_mN=held_uncertainty_mN(table, hold, rig),
        zero_age_s=figures.last_of(table, "zero_age_s", hold),
        rmse_position_um=figures.rms(position_error(table), hold),
        rmse_force_mN=figures.rms(error_mN, hold),
        true_force_held_mN=figures.mean(series(table, "true_force_mN"), hold),
        error_sources=sources_of(table, hold, rig),
    )
    return Evaluation(result)


def held_uncertainty_mN(table: Columns, hold: Mask, rig: RigFile) -> float | None:
    """Return the uncertainty of the mean force over the hold, in mN; None without a hold."""
    stated_mN = chosen(series(table, "force_uncertainty_mN"), hold)
    if not stated_mN.size:
        return None
    reading_mN = rig.sensor.noise_um / rig.model.compliance_um_per_mN
    noise_mN = reading_mN * derived.force_observer(rig).noise_gain
    return uncertainty_of_mean(stated_mN.tolist(), noise_mN=noise_mN, reading_mN=reading_mN)


def plot(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Draw position, force, their errors and voltage over a common time axis."""
    table, result = run.table, evaluation.result
    if not isinstance(result, GripResult):
        return pairs.plot(run, evaluation, name)
    sheet = Sheet()
    drawing.contact_over_time(sheet, table, result, run.period_s, run.planned.values)
    if result.error_sources is not None:
        # Drawn below the time axis, which is moved up to make room.
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
    words = [f"requested {result.force_target_mN:g} mN", *drawing.contact_words(result)]
    if result.peak_force_mN is not None:
        words.append(f"peak {result.peak_force_mN:.2f} mN")
    if result.true_force_held_mN is not None:
        words.append(f"true force held {result.true_force_held_mN:.2f} mN")
    return "   ·   ".join(words)


def chosen_speeds(request: GripJobRequest, rig: RigFile) -> QuickSpeeds | None:
    """Return the speeds of a quick grip; None for a gentle one.

    Raises
    ------
    FaultyRequestError
        If the request specifies a quick grip that the model or the force does not allow, or a quick
        load in a gentle grip.
    """
    profile, asked = request.profile or rig.grip.profile, request.profile == "quick"
    speeds = None if profile == "gentle" else _speeds(request, rig, asked=asked)
    if speeds is None and request.load_um_per_s is not None:
        raise FaultyRequestError(
            "/load_um_per_s",
            f"load_um_per_s = {request.load_um_per_s:g} µm/s is for quick grips only: give "
            "load_s instead",
        )
    return speeds


def _speeds(request: GripJobRequest, rig: RigFile, *, asked: bool) -> QuickSpeeds | None:
    """Return the speeds of a quick grip; None if it is impossible and was not explicitly
    requested."""
    if rig.model.free_response is None:
        if asked:
            raise FaultyRequestError(
                "/profile",
                'profile = "quick" needs an identified free response, but the model in use '
                f"has none: calibrate free_response, {GENTLY}",
            )
        return None
    grip, usual = rig.grip, rig.grip.quick
    force_mN = request.force_mN or grip.force_mN
    touch = arm_touch(rig, force_mN, request.contact_force_mN or grip.contact_force_mN)
    found = quick_speeds(
        AskedSpeeds(
            request.approach_um_per_s, request.seek_um_per_s, request.load_um_per_s, request.load_s
        ),
        UsualSpeeds(usual.approach_um_per_s, usual.seek_um_per_s, usual.load_um_per_s),
        touch,
        rig.part.stiffness_mN_per_um,
        derived.planned_rig(rig),
    )
    if found is None and asked:
        (weak,) = weak_force(touch.force_mN, touch.contact_force_mN, "/force_mN", 0.0)
        raise FaultyRequestError("/force_mN", f"force_mN: {weak.message}")
    slow = grip.seek_um_per_s
    if found is not None and not asked and request.seek_um_per_s is None:
        return found if found.seek_um_per_s >= slow else None
    return found


FUNCTIONS = JobFunctions(plan=plan, evaluate=evaluate, plot=plot, pointer=pointer)
