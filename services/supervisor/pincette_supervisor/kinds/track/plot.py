"""Picture of a tracked path: curves over time from the load phase on, and force over position."""

from collections.abc import Sequence

import numpy as np

from pincette.records.columns import Columns
from pincette_supervisor.kinds import pairs
from pincette_supervisor.kinds.track import Tracking, TrackResult
from pincette_supervisor.plugin import Evaluation, Run, drawing
from pincette_supervisor.plugin.drawing import (
    FAINT,
    INK,
    MEASURED,
    REFERENCE,
    TRUE,
    Axis,
    Picture,
    Sheet,
)
from pincette_supervisor.plugin.error_sources import draw_sources
from pincette_supervisor.plugin.figures import Mask, Series, series, within
from pincette_supervisor.plugin.result import PRESSED

LEFT, MIDDLE, RIGHT = 0.085, 0.685, 0.985
"""Edges of the two columns, as shares of the width."""
TOP, BOTTOM = 0.875, 0.06


def plot(run: Run, evaluation: Evaluation, name: str) -> Picture:
    """Draw a track job on a sheet of 1400 by 1180 pixels."""
    table, result = run.table, evaluation.result
    if not isinstance(result, TrackResult):
        return pairs.plot(run, evaluation, name)
    sheet = Sheet()
    figure = sheet.figure
    left = figure.add_gridspec(
        5,
        1,
        height_ratios=(3.0, 3.0, 1.4, 1.4, 1.4),
        left=LEFT,
        right=MIDDLE - 0.03,
        top=TOP,
        bottom=BOTTOM,
        hspace=0.13,
    )
    axes: list[Axis] = [figure.add_subplot(left[0])]
    axes += [figure.add_subplot(left[row], sharex=axes[0]) for row in range(1, 5)]
    cycles = [one.position_um for one in result.cycles]
    rows = 2 if len(cycles) < 2 else 3
    # The causes of a track's errors are below the right column.
    low = BOTTOM if result.error_sources is None else BOTTOM + 0.13
    right = figure.add_gridspec(
        rows,
        1,
        left=MIDDLE + 0.055,
        right=RIGHT,
        top=TOP,
        bottom=low,
        hspace=0.25 if rows == 2 else 0.42,
    )
    if result.error_sources is not None:
        causes = figure.add_axes((MIDDLE + 0.055, 0.025, RIGHT - MIDDLE - 0.055, 0.08))
        draw_sources(causes, result.error_sources, columns=3)
    _over_time(axes, table, result, run.period_s)
    tracked = within(table, ["track"])
    _loops(figure.add_subplot(right[0]), figure.add_subplot(right[1]), table, tracked)
    if rows == 3:
        _by_cycle(figure.add_subplot(right[2]), cycles)
    figure.align_ylabels(axes)
    sheet.head(LEFT, _title(result), _subtitle(result), name)
    return sheet.picture()


def _over_time(axes: list[Axis], table: Columns, result: TrackResult, period_s: float) -> None:
    t_s, begin_s, end_s = series(table, "t_s"), 0.0, drawing.end_of(table, period_s)
    for phase in result.phases:
        if phase.phase == "load":
            begin_s = phase.start_s
        elif phase.phase == "unload":
            end_s = phase.start_s + phase.duration_s
    labels = ("position / µm", "contact force / mN", "$x - x_r$ / µm", "$F - F_r$ / mN", "$u$ / V")
    for axis, label in zip(axes, labels, strict=True):
        drawing.prepare(axis, label)
        drawing.shade(axis, result)
        axis.tick_params(labelbottom=axis is axes[-1])
    seen = (t_s >= begin_s) & (t_s < end_s)
    shown: Columns = {
        column: [value for value, there in zip(values, seen, strict=True) if there]
        for column, values in table.items()
    }
    t_s = t_s[seen]
    drawing.position(axes[0], t_s, shown, columns=2)
    drawing.force(axes[1], t_s, shown, columns=4)
    for axis in axes[:2]:
        drawing.make_room(axis)
    pressed = within(shown, PRESSED)
    # The references of the first pressed sample are those of the seek.
    pressed[1:] &= pressed[:-1]
    pressed[:1] = False
    force_r = series(shown, "force_r_mN")

    def error(axis: Axis, values: Series, color: str, label: str, *, dotted: bool = False) -> None:
        seen = np.where(pressed, values, np.nan)
        drawing.line(axis, t_s, seen, color, label, width=0.9, dotted=dotted)

    error(axes[2], series(shown, "x_um") - series(shown, "x_r_um"), MEASURED, "measured")
    error(axes[3], series(shown, "force_mN") - force_r, MEASURED, "estimated")
    if drawing.knows_truth(shown):
        error(axes[3], series(shown, "true_force_mN") - force_r, TRUE, "true", dotted=True)
        drawing.legend(axes[3], columns=2)
        drawing.make_room(axes[3], 0.35)
    for axis in axes[2:4]:
        axis.axhline(0.0, color=FAINT, linewidth=0.7, zorder=1)
    drawing.line(axes[4], t_s, series(shown, "voltage_V"), MEASURED, "$u$ applied")
    axes[-1].set_xlabel("time / s")
    axes[0].set_xlim(begin_s, max(end_s, begin_s + period_s))
    drawing.name_phases(axes[0], result, begin_s, end_s)


def _loops(line: Axis, loop: Axis, table: Columns, tracked: Mask) -> None:
    """Draw force over position, if plan and contact have the same line, and position over
    voltage."""
    drawing.prepare(line, "contact force / mN", "position / µm")
    drawing.prepare(loop, "position / µm", "voltage / V")
    for axis in (line, loop):
        axis.set_facecolor("#f6f7f8")
    x_um = series(table, "x_um")[tracked]
    force_mN = series(table, "force_mN")[tracked]
    drawing.line(line, x_um, force_mN, MEASURED, "estimated", width=0.8)
    if drawing.knows_truth(table):
        true_x, true_force = series(table, "true_x_um"), series(table, "true_force_mN")
        drawing.line(
            line, true_x[tracked], true_force[tracked], TRUE, "true", width=1.0, dotted=True
        )
    x_r, force_r = series(table, "x_r_um")[tracked], series(table, "force_r_mN")[tracked]
    drawing.line(line, x_r, force_r, REFERENCE, "reference", dashed=True)
    drawing.legend(line)
    drawing.line(loop, series(table, "voltage_V")[tracked], x_um, MEASURED, "", width=0.8)
    for axis, words in ((line, "along the path"), (loop, "hysteresis along the path")):
        axis.annotate(
            words,
            (0.5, 1.0),
            xycoords="axes fraction",
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
            fontsize=9,
            color=INK,
        )


def _by_cycle(axis: Axis, errors_um: Sequence[float | None]) -> None:
    """Draw the position error over the cycles at full amplitude."""
    drawing.prepare(axis, "RMSE of $x$ / µm", "cycle at full amplitude")
    known = [(float(n + 1), error) for n, error in enumerate(errors_um) if error is not None]
    numbers, errors = np.array([n for n, _ in known]), np.array([error for _, error in known])
    drawing.line(axis, numbers, errors, MEASURED, "", width=1.2)
    axis.set_ylim(bottom=0.0)


def _title(result: TrackResult) -> str:
    outcome = result.outcome.replace("_", " ")
    position, force = _percent(result.position_um), _percent(result.force_mN)
    if not position or not force:
        return f"{outcome}: the path was not tracked"
    return f"{outcome}: RMSE {position} in position, {force} in force"


def _percent(tracking: Tracking | None) -> str:
    if tracking is None or tracking.rmse_percent is None:
        return ""
    return f"{tracking.rmse_percent:.2f} %"


def _subtitle(result: TrackResult) -> str:
    words: list[str] = []
    if result.x_pp_um is not None and result.force_pp_mN is not None:
        height = f"{result.x_pp_um:.2f} µm and {result.force_pp_mN:.1f} mN peak to peak"
        words.append(f"{result.shape} of {height}")
    words.extend(drawing.contact_words(result))
    true = _percent(result.true_force_mN)
    if true:
        words.append(f"true force RMSE {true}")
    return "   ·   ".join(words)
