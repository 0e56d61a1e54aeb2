"""Common parts of job pictures: size, colours, axes over time, phases, legends."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, cast

import numpy as np

from pincette.api.results import ClosedLoopResult, JobResult
from pincette.records.columns import Columns
from pincette_supervisor.plugin.figures import Series, series

# Matplotlib's keyword arguments have no type annotations, hence Any.
Axis = Any

WIDTH_PX, HEIGHT_PX, DPI = 1400, 1180, 140
A4_IN = 8.27, 11.69
"""Width and height of an upright A4 page, in inches."""
LEFT, RIGHT, TOP, BOTTOM = 0.085, 0.985, 0.89, 0.065
"""Edges of the axes of a grid, as shares of the picture."""
DOT = {"linestyle": "none", "marker": "o", "markersize": 5.0}
INK, FAINT = "#22282f", "#8a939c"
MEASURED, REFERENCE, TRUE = "#1f5f8b", "#d1792b", "#3f8f5f"
SECOND = "#8a4f9e"
"""Line colour of the second arm."""
SHADES: Mapping[str, str] = {
    "zero": "#eef1f4",
    "open": "#e4ebf2",
    "approach": "#e4ebf2",
    "contact": "#f6ecd9",
    "load": "#f3e0cf",
    "hold": "#dfeee4",
    "settle": "#eef1f4",
    "track": "#dfeee4",
    "unload": "#f3e0cf",
    "retreat": "#e4ebf2",
    "warm up": "#eef1f4",
    "condition": "#f6ecd9",
    "move": "#e4ebf2",
    "rest": "#eef1f4",
    "stopping": "#f2dada",
    "stopped": "#f2dada",
}
SHORT_SHARE = 0.045
"""Width of a phase below which its name is written vertically, as a fraction of the time axis."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture in all file formats of a record."""

    png: bytes
    vector: Mapping[str, bytes] = field(default_factory=dict[str, bytes])
    """Further files of the same name, such as vector files for print, by file name extension:
    ``.svg``, ``.pdf``, ``.html`` or ``.json``."""


class Sheet:
    """Picture to draw on, of 1400 by 1180 pixels unless another size is given."""

    def __init__(self, size_in: tuple[float, float] = (WIDTH_PX / DPI, HEIGHT_PX / DPI)) -> None:
        # Imported with the first picture, since the import would take a third of the supervisor's
        # start.
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.figure: Any = Figure(figsize=size_in, dpi=DPI, facecolor="white")
        self._canvas: Any = FigureCanvasAgg(self.figure)

    def head(self, left: float, title: str, subtitle: str, name: str) -> None:
        """Write the outcome of the job, and the names of job and rig, above the axes."""
        self.figure.text(left, 0.962, title, fontsize=12.5, color=INK, weight="bold")
        self.figure.text(left, 0.936, subtitle, fontsize=9, color=INK)
        self.figure.text(0.985, 0.966, name, fontsize=8, color=FAINT, ha="right")

    def png(self) -> bytes:
        """Return the picture as a PNG and discard the sheet."""
        stream = BytesIO()
        self._canvas.print_png(stream)
        # Discard the sheet: its texts and axes form reference cycles with the 7 MB canvas, which
        # would otherwise stay in memory until the garbage collector runs.
        self.figure.clear()
        drawn_on = cast("dict[str, Any]", vars(self._canvas.renderer))
        drawn_on.clear()
        return stream.getvalue()

    def picture(self) -> Picture:
        """Return the picture as PNG, SVG and PDF; the files contain no time stamp."""
        vector: dict[str, bytes] = {}
        for form, stamp in (("svg", "Date"), ("pdf", "CreationDate")):
            stream = BytesIO()
            self.figure.savefig(stream, format=form, metadata={stamp: None})
            vector[f".{form}"] = stream.getvalue()
        return Picture(self.png(), vector)


def pdf(sheets: Sequence[Sheet]) -> bytes:
    """Return a PDF file with a page for each sheet; it contains no time stamp."""
    from matplotlib.backends.backend_pdf import PdfPages

    stream = BytesIO()
    pages: Any = PdfPages(stream, metadata={"CreationDate": None})
    for sheet in sheets:
        pages.savefig(sheet.figure)
    pages.close()
    return stream.getvalue()


def prepare(axis: Axis, y_label: str = "", x_label: str = "") -> None:
    """Set style and labels of axes."""
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axis.spines[side].set_color(FAINT)
    axis.tick_params(colors=INK, labelsize=8.5, length=3)
    axis.grid(axis="y", color="white", linewidth=0.9)
    axis.set_axisbelow(True)
    axis.yaxis.label.set(size=9.5, color=INK)
    axis.xaxis.label.set(size=9.5, color=INK)
    axis.margins(y=0.1)
    axis.set_ylabel(y_label)
    axis.set_xlabel(x_label)


def shade(axis: Axis, result: JobResult) -> None:
    """Colour the phases, with a line at each beginning, since their colours look the same in
    grey."""
    for phase in result.phases:
        colour = SHADES.get(phase.phase, "#f0f0f0")
        end_s = phase.start_s + phase.duration_s
        axis.axvspan(phase.start_s, end_s, facecolor=colour, edgecolor="none", zorder=0)
        axis.axvline(phase.start_s, color=FAINT, linewidth=0.5, linestyle=(0, (1, 2)), zorder=1)


def name_phases(axis: Axis, result: JobResult, begin_s: float, end_s: float) -> None:
    """Write the names of the visible phases above the axes."""
    for phase in result.phases:
        since = max(begin_s, phase.start_s)
        until = min(end_s, phase.start_s + phase.duration_s)
        if until <= since:
            continue
        narrow = until - since < SHORT_SHARE * (end_s - begin_s)
        axis.annotate(
            phase.phase,
            (0.5 * (since + until), 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
            va="bottom",
            rotation=90 if narrow else 0,
            fontsize=8 if narrow else 9,
            color=INK,
        )


def end_of(table: Columns, period_s: float) -> float:
    """Return the time of the end of the last sample, in s."""
    return float(table["t_s"][-1]) + period_s if table["t_s"] else 1.0


def line(
    axis: Axis,
    t_s: Series,
    values: Series,
    color: str,
    label: str,
    *,
    width: float = 1.3,
    dashed: bool = False,
    dotted: bool = False,
) -> None:
    """Draw a line, with gaps at missing samples; its dashes distinguish it in grey."""
    style = (0, (4, 2)) if dashed else (0, (1, 1)) if dotted else "solid"
    axis.plot(t_s, values, color=color, linewidth=width, linestyle=style, label=label)


def position(axis: Axis, t_s: Series, table: Columns, *, columns: int = 1) -> None:
    """Draw x and x_r."""
    line(axis, t_s, series(table, "x_um"), MEASURED, "$x$ measured")
    line(axis, t_s, series(table, "x_r_um"), REFERENCE, "$x_r$ reference", dashed=True)
    legend(axis, columns=columns)


def force(axis: Axis, t_s: Series, table: Columns, *, columns: int = 1) -> None:
    """Draw F̂ with its uncertainty, F_r, and the true force where it is known."""
    estimated, spread = series(table, "force_mN"), series(table, "force_uncertainty_mN")
    # Before the first zero an estimate has no reference, and its uncertainty no bound.
    zeroed = ~np.isnan(series(table, "zero_age_s"))
    estimated, spread = np.where(zeroed, estimated, np.nan), np.where(zeroed, spread, np.nan)
    axis.fill_between(
        t_s,
        estimated - spread,
        estimated + spread,
        color=MEASURED,
        alpha=0.2,
        linewidth=0,
        label="uncertainty",
    )
    line(axis, t_s, estimated, MEASURED, "$F$ estimated")
    line(axis, t_s, series(table, "force_r_mN"), REFERENCE, "$F_r$ reference", dashed=True)
    if knows_truth(table):
        true = series(table, "true_force_mN")
        line(axis, t_s, true, TRUE, "$F$ true (simulation)", width=1.3, dotted=True)
    legend(axis, columns=columns)


def knows_truth(table: Columns) -> bool:
    """Return whether the samples contain the true force of a simulated rig."""
    return any(value is not None for value in table["true_force_mN"])


def legend(axis: Axis, *, columns: int = 1) -> None:
    """Draw the legend."""
    axis.legend(
        loc="upper left",
        fontsize=8.5,
        frameon=False,
        labelcolor=INK,
        handlelength=1.8,
        columnspacing=1.2,
        ncols=columns,
    )


def make_room(axis: Axis, share: float = 0.16) -> None:
    """Leave room above the lines for the legend."""
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + share * (high - low))


def contact_words(result: ClosedLoopResult) -> Sequence[str]:
    """Return position and stiffness of the contact in words, if they are known."""
    if result.contact_stiffness_mN_per_um is None or result.contact_x_um is None:
        return ()
    return (
        f"contact at {result.contact_x_um:.2f} µm, "
        f"stiffness {result.contact_stiffness_mN_per_um:.2f} mN/µm",
    )


def grid(sheet: "Sheet", rows: int, columns: int = 1) -> list[Axis]:
    """Return separate axes in rows and columns."""
    found = sheet.figure.subplots(rows, columns, squeeze=False)
    sheet.figure.subplots_adjust(
        left=LEFT, right=RIGHT, top=TOP, bottom=BOTTOM, hspace=0.24, wspace=0.2
    )
    return list(found.flat)


def zero_line(axis: Axis) -> None:
    """Draw a faint line at 0."""
    axis.axhline(0.0, color=FAINT, linewidth=0.7, zorder=1)


def errors(
    position_axis: Axis, force_axis: Axis, t_s: Series, table: Columns, values: Mapping[str, Any]
) -> None:
    """Draw x − x_r and F̂ − F_r with the tolerances of the job."""
    zeroed = ~np.isnan(series(table, "zero_age_s"))
    force_error = series(table, "force_mN") - series(table, "force_r_mN")
    drawn = (
        (position_axis, series(table, "x_um") - series(table, "x_r_um"), "position_tolerance_um"),
        (force_axis, np.where(zeroed, force_error, np.nan), "force_tolerance_mN"),
    )
    for axis, error, name in drawn:
        zero_line(axis)
        line(axis, t_s, error, MEASURED, "", width=0.9)
        tolerance = values.get(name)
        if tolerance is not None:
            label = f"tolerance ± {tolerance:g}"
            for side in (-tolerance, tolerance):
                axis.axhline(side, color=INK, linewidth=0.8, linestyle=(0, (5, 2)), label=label)
                label = ""
            legend(axis)
            make_room(axis, 0.3)


def contact_over_time(
    sheet: Sheet,
    table: Columns,
    result: ClosedLoopResult,
    period_s: float,
    values: Mapping[str, Any],
) -> None:
    """Draw position and contact force, their errors, and the voltage over a common time axis."""
    figure = sheet.figure
    heights = (3.0, 3.0, 1.4, 1.4, 1.6)
    axes: list[Axis] = list(figure.subplots(len(heights), 1, sharex=True, height_ratios=heights))
    figure.subplots_adjust(left=0.085, right=0.985, top=0.875, bottom=0.06, hspace=0.14)
    t_s, end_s = series(table, "t_s"), end_of(table, period_s)
    labels = ("position / µm", "contact force / mN", "$x - x_r$ / µm", "$F - F_r$ / mN", "$u$ / V")
    for axis, label in zip(axes, labels, strict=True):
        prepare(axis, label)
        shade(axis, result)
    position(axes[0], t_s, table)
    force(axes[1], t_s, table)
    errors(axes[2], axes[3], t_s, table, values)
    line(axes[4], t_s, series(table, "voltage_V"), MEASURED, "$u$ applied")
    axes[-1].set_xlabel("time / s")
    axes[-1].set_xlim(0.0, end_s)
    name_phases(axes[0], result, 0.0, end_s)
    figure.align_ylabels(axes)
