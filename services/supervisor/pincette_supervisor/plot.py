"""A picture of a grip: position, force, voltage and sliding function over one time."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pincette_supervisor.columns import Columns
from pincette_supervisor.result_models import GripResult

# Matplotlib's keyword arguments carry no types.
Axis = Any

WIDTH_PX, HEIGHT_PX, DPI = 1400, 1180, 140
INK, FAINT = "#22282f", "#8a939c"
MEASURED, REFERENCE, TRUE = "#1f5f8b", "#d1792b", "#3f8f5f"
SHADES: Mapping[str, str] = {
    "zero": "#eef1f4",
    "approach": "#e4ebf2",
    "contact": "#f6ecd9",
    "load": "#f3e0cf",
    "hold": "#dfeee4",
    "unload": "#f3e0cf",
    "retreat": "#e4ebf2",
    "stopping": "#f2dada",
}
SHORT_SHARE = 0.045
"""A phase narrower than this share of the time is named upright."""


def grip_png(table: Columns, result: GripResult, *, name: str, period_s: float) -> bytes:
    """Draw a grip as a PNG of 1400 by 1180 pixels.

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
    figure: Any = Figure(figsize=(WIDTH_PX / DPI, HEIGHT_PX / DPI), dpi=DPI, facecolor="white")
    canvas: Any = FigureCanvasAgg(figure)
    axes: list[Axis] = list(figure.subplots(4, 1, sharex=True, height_ratios=(3.0, 3.0, 1.6, 1.6)))
    figure.subplots_adjust(left=0.085, right=0.985, top=0.875, bottom=0.06, hspace=0.12)
    t_s = _series(table["t_s"])
    end_s = float(t_s[-1]) + period_s if t_s.size else 1.0
    for axis in axes:
        _prepare(axis)
        _shade(axis, result)
    _position(axes[0], t_s, table)
    _force(axes[1], t_s, table)
    _line(axes[2], t_s, table["voltage_V"], MEASURED, "$u$ applied")
    axes[2].set_ylabel("voltage / V")
    _line(axes[3], t_s, table["sliding_um"], MEASURED, "s", width=0.9)
    axes[3].axhline(0.0, color=FAINT, linewidth=0.7, zorder=1)
    axes[3].set_ylabel("sliding / µm")
    axes[3].set_xlabel("time / s")
    axes[3].set_xlim(0.0, end_s)
    _name_phases(axes[0], result, end_s)
    figure.align_ylabels(axes)
    figure.text(0.085, 0.962, _title(result), fontsize=12.5, color=INK, weight="bold")
    figure.text(0.085, 0.936, _subtitle(result), fontsize=9, color=INK)
    figure.text(0.985, 0.966, name, fontsize=8, color=FAINT, ha="right")
    stream = BytesIO()
    canvas.print_png(stream)
    return stream.getvalue()


def _series(values: Sequence[Any]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _prepare(axis: Axis) -> None:
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


def _shade(axis: Axis, result: GripResult) -> None:
    for phase in result.phases:
        shade = SHADES.get(phase.phase, "#f0f0f0")
        end_s = phase.start_s + phase.duration_s
        axis.axvspan(phase.start_s, end_s, facecolor=shade, edgecolor="none", zorder=0)


def _line(
    axis: Axis,
    t_s: NDArray[np.float64],
    values: Sequence[Any],
    color: str,
    label: str,
    *,
    width: float = 1.3,
    dashed: bool = False,
) -> None:
    style = (0, (4, 2)) if dashed else "solid"
    axis.plot(t_s, _series(values), color=color, linewidth=width, linestyle=style, label=label)


def _position(axis: Axis, t_s: NDArray[np.float64], table: Columns) -> None:
    _line(axis, t_s, table["x_um"], MEASURED, "$x$ measured")
    _line(axis, t_s, table["x_r_um"], REFERENCE, "$x_r$ reference", dashed=True)
    axis.set_ylabel("position / µm")
    _legend(axis)


def _force(axis: Axis, t_s: NDArray[np.float64], table: Columns) -> None:
    force, spread = _series(table["force_mN"]), _series(table["force_uncertainty_mN"])
    # Before the first zero an estimate has no reference, and its uncertainty no bound.
    zeroed = ~np.isnan(_series(table["zero_age_s"]))
    force, spread = np.where(zeroed, force, np.nan), np.where(zeroed, spread, np.nan)
    axis.fill_between(
        t_s,
        force - spread,
        force + spread,
        color=MEASURED,
        alpha=0.2,
        linewidth=0,
        label="uncertainty",
    )
    axis.plot(t_s, force, color=MEASURED, linewidth=1.3, label="$F$ estimated")
    _line(axis, t_s, table["force_r_mN"], REFERENCE, "$F_r$ reference", dashed=True)
    if any(value is not None for value in table["true_force_mN"]):
        _line(axis, t_s, table["true_force_mN"], TRUE, "$F$ true (simulation)", width=1.0)
    axis.set_ylabel("contact force / mN")
    _legend(axis)


def _legend(axis: Axis) -> None:
    axis.legend(loc="upper left", fontsize=8.5, frameon=False, labelcolor=INK, handlelength=2.2)


def _name_phases(axis: Axis, result: GripResult, end_s: float) -> None:
    for phase in result.phases:
        narrow = phase.duration_s < SHORT_SHARE * end_s
        axis.annotate(
            phase.phase,
            (phase.start_s + 0.5 * phase.duration_s, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
            va="bottom",
            rotation=90 if narrow else 0,
            fontsize=8 if narrow else 9,
            color=INK,
        )


def _title(result: GripResult) -> str:
    outcome = result.outcome.replace("_", " ")
    if result.force_held_mN is None:
        return f"{outcome}: no force was held"
    spread = "" if result.force_uncertainty_mN is None else f" ± {result.force_uncertainty_mN:.2f}"
    return f"{outcome}: {result.force_held_mN:.2f}{spread} mN held"


def _subtitle(result: GripResult) -> str:
    words = [f"asked for {result.force_target_mN:g} mN"]
    if result.contact_stiffness_mN_per_um is not None and result.contact_x_um is not None:
        words.append(
            f"contact at {result.contact_x_um:.2f} µm, "
            f"stiffness {result.contact_stiffness_mN_per_um:.2f} mN/µm"
        )
    if result.peak_force_mN is not None:
        words.append(f"peak {result.peak_force_mN:.2f} mN")
    if result.true_force_held_mN is not None:
        words.append(f"true force held {result.true_force_held_mN:.2f} mN")
    return "   ·   ".join(words)
