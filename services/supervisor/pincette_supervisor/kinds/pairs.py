"""Result and plot of a job of both arms, with the difference of both forces; plan of a carry."""

from math import hypot
from typing import Any

import numpy as np
from msgspec.structs import replace

from pincette.api.pairs import PairResult
from pincette.control.planning.calibration_programs import FREE
from pincette.control.planning.pair_plan import carry_program
from pincette.control.planning.pair_prediction import HeldPair
from pincette.control.planning.paths import Path
from pincette.control.planning.segments import Track
from pincette.records.columns import Columns
from pincette_supervisor.kinds.motions import CarryJobRequest
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
from pincette_supervisor.plugin.drawing import MEASURED, REFERENCE, SECOND, TRUE, Picture, Sheet
from pincette_supervisor.plugin.figures import Mask, Series, series, table_of_arm, within
from pincette_supervisor.plugin.pair_plans import contacts_um, pair_job
from pincette_supervisor.plugin.plans import CONTACT_FIELDS, contact_values
from pincette_supervisor.plugin.result import (
    course,
    full_amplitude,
    stroke_of,
    tracking,
    zero_invalid,
    zero_unconfirmed,
)


def evaluate(run: Run) -> Evaluation:
    """Compute the results of a job of both arms."""
    table = run.table
    chosen = evaluated(run)
    zeroed = ~np.isnan(series(table, "zero_age_s")) & ~np.isnan(series(table, "second_zero_age_s"))
    known = chosen & zeroed
    force_r, place_r = series(table, "force_r_mN"), series(table, "place_r_um")
    first, second = series(table, "force_mN"), series(table, "second_force_mN")
    true_force = 0.5 * (series(table, "true_force_mN") + series(table, "true_second_force_mN"))
    true_place = 0.5 * (series(table, "true_x_um") - series(table, "true_second_x_um"))
    place, force = series(table, "place_um"), 0.5 * (first + second)
    # A resting reference has no peak-to-peak value.
    place_pp, force_pp = (
        figures.peak_to_peak(each, chosen) if path is not None else None
        for each, path in zip((place_r, force_r), _paths(run), strict=True)
    )
    spreads = [
        figures.mean(series(table, name), known)
        for name in ("force_uncertainty_mN", "second_force_uncertainty_mN")
    ]
    apart_mN = None if None in spreads else hypot(spreads[0] or 0.0, spreads[1] or 0.0)
    difference_mN = figures.mean(first - second, known)
    agree = None
    if difference_mN is not None and apart_mN is not None:
        agree = abs(difference_mN) <= apart_mN
    peaks = [figures.largest(each, zeroed) for each in (first, second)]
    held = [item for item in table["held"] if item is not None]
    strokes = [stroke_of(table_of_arm(table, number)) for number in (1, 2)]
    result = PairResult(
        **course(table, period_s=run.period_s, dropped=run.dropped),
        met_place_um=figures.last(table["contact_x_um"]),
        held_place_um=figures.mean(place, chosen),
        force_held_mN=figures.mean(force, known),
        force_uncertainty_mN=None if apart_mN is None else 0.5 * apart_mN,
        place_um=tracking(place - place_r, chosen, place_pp),
        force_mN=tracking(force - force_r, known, force_pp),
        true_place_um=tracking(true_place - place_r, chosen, place_pp),
        true_force_mN=tracking(true_force - force_r, known, force_pp),
        difference_mN=difference_mN,
        difference_uncertainty_mN=apart_mN,
        forces_agree=agree,
        peak_force_mN=max((peak for peak in peaks if peak is not None), default=None),
        held_at_end=bool(held[-1]) if held else False,
        stroke_change_percent=strokes[0].change_percent,
        stroke_limit_percent=strokes[0].limit_percent,
        second_stroke_change_percent=strokes[1].change_percent,
        second_stroke_limit_percent=strokes[1].limit_percent,
        model_mismatch=any(stroke.mismatch for stroke in strokes),
        zero_unconfirmed=any(zero_unconfirmed(table_of_arm(table, number)) for number in (1, 2)),
        zero_invalid=any(zero_invalid(table_of_arm(table, number)) for number in (1, 2)),
    )
    return Evaluation(result)


def evaluated(run: Run) -> Mask:
    """Return the samples for which errors are computed: the path at full amplitude, else the hold
    or the rest.
    """
    known: list[Path] = [path for path in _paths(run) if path is not None]
    if known:
        return full_amplitude(run, known)
    phase = "hold" if "hold" in run.table["phase"] else "rest"
    return figures.settled(within(run.table, [phase]), run.period_s)


def _paths(run: Run) -> tuple[Path | None, Path | None]:
    """Return the paths of place and force; None where there is none."""
    tracks = (one for one in run.planned.program.segments if isinstance(one, Track))
    track = next(tracks, None)
    return (None, None) if track is None else (track.place, track.force)


def plot(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Draw place, both forces and both voltages over a common time axis."""
    table, result = run.table, evaluation.result
    assert isinstance(result, PairResult)
    sheet = Sheet()
    place, force, voltage = axes = drawing.grid(sheet, 3)
    t_s = series(table, "t_s")
    labels = "place $q$ (µm)", "force $F$ (mN)", "voltage (V)"
    for axis, label in zip(axes, labels, strict=True):
        drawing.prepare(axis, label, "time (s)" if axis is voltage else "")
        drawing.shade(axis, result)
    _place(place, t_s, table)
    _forces(force, t_s, table)
    drawing.line(voltage, t_s, series(table, "voltage_V"), MEASURED, "$u_1$")
    drawing.line(voltage, t_s, series(table, "second_voltage_V"), SECOND, "$u_2$", dashed=True)
    drawing.legend(voltage, columns=2)
    end_s = drawing.end_of(table, run.period_s)
    drawing.name_phases(place, result, 0.0, end_s)
    for axis in axes:
        drawing.make_room(axis)
        axis.set_xlim(0.0, end_s)
    sheet.head(drawing.LEFT, _title(result), _subtitle(result), name)
    return sheet.picture()


def _place(axis: Any, t_s: Series, table: Columns) -> None:
    drawing.line(axis, t_s, series(table, "place_um"), MEASURED, "$q$ measured")
    drawing.line(axis, t_s, series(table, "place_r_um"), REFERENCE, "$q_r$ reference", dashed=True)
    drawing.legend(axis, columns=2)


def _forces(axis: Any, t_s: Series, table: Columns) -> None:
    for name, color, label in (
        ("force_mN", MEASURED, "$F_1$ estimated"),
        ("second_force_mN", SECOND, "$F_2$ estimated"),
    ):
        zeroed = ~np.isnan(series(table, name.replace("force_mN", "zero_age_s")))
        drawing.line(axis, t_s, np.where(zeroed, series(table, name), np.nan), color, label)
    drawing.line(axis, t_s, series(table, "force_r_mN"), REFERENCE, "$F_r$ reference", dashed=True)
    if drawing.knows_truth(table):
        true = 0.5 * (series(table, "true_force_mN") + series(table, "true_second_force_mN"))
        drawing.line(axis, t_s, true, TRUE, "$F$ true (simulation)", dotted=True)
    drawing.legend(axis, columns=2)


def _title(result: PairResult) -> str:
    outcome = result.outcome.replace("_", " ")
    if result.force_held_mN is None or result.held_place_um is None:
        return f"{outcome}: no part was held"
    return f"{outcome}: {result.force_held_mN:.2f} mN at {result.held_place_um:.2f} µm"


def _subtitle(result: PairResult) -> str:
    words: list[str] = []
    if result.place_um is not None:
        words.append(f"place error {result.place_um.rmse:.3f} µm r.m.s.")
    if result.force_mN is not None:
        words.append(f"force error {result.force_mN.rmse:.2f} mN r.m.s.")
    if result.difference_mN is not None:
        remark = ", more than the stated uncertainty" if result.forces_agree is False else ""
        words.append(f"forces differ by {result.difference_mN:.2f} mN{remark}")
    if result.true_force_mN is not None:
        words.append(f"true force error {result.true_force_mN.rmse:.2f} mN r.m.s.")
    return "   ·   ".join(words)


MORE_TOUCHES = 2.0
"""Largest increase of the unknown gripping force during a carry, as a multiple of the contact
force.
"""


def carry_job(request: CarryJobRequest, model: ModelInUse, present: Present) -> Planned:
    """Plan a carry from the present positions of both tips."""
    rig = model.rig
    tips = present.tips_um
    by_um = request.by_um or 0.0
    if request.to_um is not None:
        if tips is None:
            raise FaultyRequestError(
                "/to_um", "the positions of the tips are not known yet: use by_um, or wait"
            )
        by_um = request.to_um - 0.5 * (tips[0] - tips[1])
    values = contact_values(request, CONTACT_FIELDS, rig)
    limits = rig.limits
    guards = replace(
        FREE,
        force_max_mN=MORE_TOUCHES * values["contact_force_mN"],
        position_min_um=limits.position_min_um,
        position_max_um=limits.position_max_um,
    )
    program = carry_program(
        by_um,
        values["approach_um_per_s"],
        guards,
        release_s=values["load_s"],
        safe_V=rig.safety.safe_V,
    )
    pointer = "/to_um" if request.to_um is not None else "/by_um"
    values |= {"by_um": by_um, "to_um": request.to_um}
    held = HeldPair(tips or contacts_um(rig))
    return pair_job(request, model, program, values, {"move": pointer}, present, held)


CARRY = JobFunctions(plan=carry_job, evaluate=evaluate, plot=plot)
