"""The picture of a move, a hold or a release."""

from pincette.api.result_models import MotionResult
from pincette.records.columns import Columns
from pincette_supervisor.results import drawing
from pincette_supervisor.results.drawing import MEASURED, Axis, Sheet
from pincette_supervisor.results.figures import series


def motion_png(table: Columns, result: MotionResult, *, name: str, period_s: float) -> bytes:
    """Position, contact force and voltage of a motion over one time."""
    sheet = Sheet()
    figure = sheet.figure
    axes: list[Axis] = list(figure.subplots(3, 1, sharex=True, height_ratios=(3.0, 2.0, 2.0)))
    figure.subplots_adjust(left=0.085, right=0.985, top=0.875, bottom=0.06, hspace=0.12)
    t_s, end_s = series(table, "t_s"), drawing.end_of(table, period_s)
    labels = ("position / µm", "contact force / mN", "voltage / V")
    for axis, label in zip(axes, labels, strict=True):
        drawing.prepare(axis, label)
        drawing.shade(axis, result)
    drawing.position(axes[0], t_s, table)
    drawing.force(axes[1], t_s, table)
    drawing.line(axes[2], t_s, series(table, "voltage_V"), MEASURED, "$u$ applied")
    axes[2].set_xlabel("time / s")
    axes[2].set_xlim(0.0, end_s)
    drawing.name_phases(axes[0], result, 0.0, end_s)
    figure.align_ylabels(axes)
    sheet.head(0.085, _title(result), _subtitle(result), name)
    return sheet.png()


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
