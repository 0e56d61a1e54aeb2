"""The picture of a job."""

from pincette.api.result_models import GripResult, MotionResult, TrackResult
from pincette.records.columns import Columns
from pincette_supervisor.results import drawing
from pincette_supervisor.results.drawing import FAINT, MEASURED, Axis, Sheet
from pincette_supervisor.results.figures import series
from pincette_supervisor.results.motion_plot import motion_png
from pincette_supervisor.results.track_plot import track_png


def picture(
    table: Columns,
    result: GripResult | TrackResult | MotionResult,
    *,
    name: str,
    period_s: float,
) -> bytes:
    """Draw a job as a PNG of 1400 by 1180 pixels.

    Parameters
    ----------
    table
        Columns of the epoch; see ``columns``.
    result
        Its figures, for the title and the phases.
    name
        Of the job and its rig, for the corner.
    period_s
        Gives the end of the last sample.
    """
    if isinstance(result, MotionResult):
        return motion_png(table, result, name=name, period_s=period_s)
    if isinstance(result, TrackResult):
        return track_png(table, result, name=name, period_s=period_s)
    return grip_png(table, result, name=name, period_s=period_s)


def grip_png(table: Columns, result: GripResult, *, name: str, period_s: float) -> bytes:
    """Position, force, voltage and sliding function of a grip over one time."""
    sheet = Sheet()
    figure = sheet.figure
    axes: list[Axis] = list(figure.subplots(4, 1, sharex=True, height_ratios=(3.0, 3.0, 1.6, 1.6)))
    figure.subplots_adjust(left=0.085, right=0.985, top=0.875, bottom=0.06, hspace=0.12)
    t_s, end_s = series(table, "t_s"), drawing.end_of(table, period_s)
    labels = ("position / µm", "contact force / mN", "voltage / V", "sliding / µm")
    for axis, label in zip(axes, labels, strict=True):
        drawing.prepare(axis, label)
        drawing.shade(axis, result)
    drawing.position(axes[0], t_s, table)
    drawing.force(axes[1], t_s, table)
    drawing.line(axes[2], t_s, series(table, "voltage_V"), MEASURED, "$u$ applied")
    drawing.line(axes[3], t_s, series(table, "sliding_um"), MEASURED, "s", width=0.9)
    axes[3].axhline(0.0, color=FAINT, linewidth=0.7, zorder=1)
    axes[3].set_xlabel("time / s")
    axes[3].set_xlim(0.0, end_s)
    drawing.name_phases(axes[0], result, 0.0, end_s)
    figure.align_ylabels(axes)
    sheet.head(0.085, _title(result), _subtitle(result), name)
    return sheet.png()


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
