"""Pictures of the report: one size, one palette."""

from collections.abc import Callable
from io import BytesIO
from typing import Any

# Matplotlib's keyword arguments have no type annotations.
Axis = Any

WIDTH_IN, DPI = 9.6, 130
INK, FAINT = "#22282f", "#8a939c"
BLUE, ORANGE, GREEN, RED = "#1f5f8b", "#d1792b", "#3f8f5f", "#b3402a"


def picture(
    rows: int,
    columns: int,
    height_in: float,
    draw: Callable[[list[Axis]], None],
    *,
    sharex: bool = False,
) -> bytes:
    """Return a PNG with rows × columns of axes, into which ``draw`` draws; it gets the axes row by
    row.
    """
    # Imported for the first picture: it takes half a second, which a help text does not need.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, facecolor="white")
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, sharex="col" if sharex else "none")
    flat: list[Axis] = list(axes.ravel())
    for axis in flat:
        _prepare(axis)
    draw(flat)
    figure.tight_layout()
    stream = BytesIO()
    canvas.print_png(stream)
    return stream.getvalue()


def label(axis: Axis, x: str, y: str, title: str = "") -> None:
    """Label both axes, and set a title unless it is empty."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    if title:
        axis.set_title(title, fontsize=10, color=INK, loc="left")


def legend(axis: Axis, place: str = "best") -> None:
    """Add a legend inside the axes, among the lines."""
    axis.legend(loc=place, fontsize=8.5, frameon=False, labelcolor=INK)


def legend_above(axis: Axis) -> None:
    """Add a legend above the axes, for pictures in which it would cover the lines."""
    axis.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 0.97),
        ncols=3,
        fontsize=8.5,
        frameon=False,
        labelcolor=INK,
        borderaxespad=0.0,
        handlelength=1.6,
        columnspacing=1.2,
    )


def _prepare(axis: Axis) -> None:
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axis.spines[side].set_color(FAINT)
    axis.tick_params(colors=INK, labelsize=8.5, length=3)
    axis.grid(color="#e6eaee", linewidth=0.8)
    axis.set_axisbelow(True)
    axis.yaxis.label.set(size=9.5, color=INK)
    axis.xaxis.label.set(size=9.5, color=INK)
