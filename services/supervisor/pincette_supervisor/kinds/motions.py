"""Result and plot of a motion: a move, a hold, a release; pure."""

import numpy as np

from pincette.api.plans import Pose
from pincette.api.results import MotionResult
from pincette.records.columns import Columns
from pincette_supervisor.plugin import Evaluation, Run, drawing, figures
from pincette_supervisor.plugin.drawing import Picture, Sheet
from pincette_supervisor.plugin.figures import Mask, series, within
from pincette_supervisor.plugin.result import common

REST_S = 0.3
"""The last part of a motion, over which its pose is taken."""


def evaluate(run: Run) -> Evaluation:
    """Work out the figures of a motion."""
    table, period_s, values = run.table, run.period_s, run.planned.values
    ends, begins = _edge(table, period_s, last=True), _edge(table, period_s, last=False)
    x_um, to_um = figures.mean(series(table, "x_um"), ends), values.get("to_um")
    held, hold = [item for item in table["held"] if item is not None], within(table, ["hold"])
    zero_age_s = figures.last(table["zero_age_s"])
    # No contact line is followed.
    shared = common(run)
    shared |= dict.fromkeys(("contact_rmse_position_um", "contact_rmse_force_mN"))
    spread_mN = figures.mean(series(table, "force_uncertainty_mN"), ends)
    result = MotionResult(
        **shared,
        force_uncertainty_mN=None if zero_age_s is None else spread_mN,
        zero_age_s=zero_age_s,
        begins_at=Pose(
            x_um=figures.mean(series(table, "x_um"), begins),
            voltage_V=figures.mean(series(table, "voltage_V"), begins),
        ),
        ends_at=Pose(x_um=x_um, voltage_V=figures.last(table["voltage_V"])),
        teach=values.get("teach"),
        target_um=to_um,
        target_error_um=None if to_um is None or x_um is None else x_um - to_um,
        drift_um=figures.peak_to_peak(series(table, "x_um"), hold),
        held_at_end=bool(held[-1]) if held else False,
    )
    return Evaluation(result)


def _edge(table: Columns, period_s: float, *, last: bool) -> Mask:
    """Return the first sample, or those of the last rest."""
    count = len(table["seq"])
    mask = np.zeros(count, dtype=np.bool_)
    if last:
        mask[max(0, count - round(REST_S / period_s)) :] = True
    else:
        mask[:1] = True
    return mask


def plot(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Draw position, contact force, their errors and voltage of a motion over one time."""
    result = evaluation.result
    assert isinstance(result, MotionResult)
    sheet = Sheet()
    drawing.contact_over_time(sheet, run.table, result, run.period_s, run.planned.values)
    sheet.head(0.085, _title(result), _subtitle(result), name)
    return sheet.picture()


def _title(result: MotionResult) -> str:
    outcome, pose = result.outcome.replace("_", " "), result.ends_at
    if pose.x_um is None or pose.voltage_V is None:
        return f"{outcome}: no position was measured"
    return f"{outcome}: at {pose.x_um:.2f} µm, {pose.voltage_V:.3f} V"


def _subtitle(result: MotionResult) -> str:
    words: list[str] = []
    if result.begins_at.x_um is not None:
        words.append(f"from {result.begins_at.x_um:.2f} µm")
    if result.target_um is not None:
        words.append(f"asked for {result.target_um:g} µm")
    if result.target_error_um is not None:
        words.append(f"off by {result.target_error_um:.3f} µm")
    if result.drift_um is not None:
        words.append(f"moved by {result.drift_um:.2f} µm while held")
    if result.held_at_end:
        words.append("a part is held")
    if result.teach is not None:
        words.append(f"pose {result.teach}")
    return "   ·   ".join(words)
