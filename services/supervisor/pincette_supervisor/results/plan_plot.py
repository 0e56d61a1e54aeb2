"""Picture of a plan: references, prediction, limits, and points at which a limit is exceeded."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pincette.api.predictions import Prediction, Violation
from pincette.config import RigFile
from pincette_supervisor.planning.predicted_samples import Samples
from pincette_supervisor.plugin import Planned, drawing
from pincette_supervisor.plugin.drawing import FAINT, MEASURED, REFERENCE, SECOND, Axis, Sheet

BROKEN, LIMIT = "#b3261e", "#a1383d"
NEAR = 1.0
"""Largest distance at which a limit is drawn, as a ratio to the span of the curves."""
TOLD = 3
"""Number of violations that are listed below the title; all are marked."""
BELOW = 0.1
"""Space below the lowest line for the label of a limit, as a share of the height."""
LATE = 0.7
"""Share of the time axis beyond which labels are to the left of a mark."""
ROW = 0.021
"""Height of a line of text, as a share of the picture's height."""
AXIS_OF = {"position": 0, "acceleration": 0, "force": 1, "voltage": 2, "slew": 2}


class Limit(NamedTuple):
    """A limit, and the axes in which it is drawn."""

    axis: int
    value: float
    words: str


def plan_png(planned: Planned, samples: Samples, *, name: str) -> bytes:
    """Draw a plan as a PNG of 1400 by 1180 pixels.

    Parameters
    ----------
    planned
        Plan with its prediction.
    samples
        Predicted samples.
    name
        Name of the rig and the plan, shown in the corner.
    """
    prediction, violations = planned.plan.prediction, planned.plan.violations
    if prediction is None:
        raise ValueError("the plan has no prediction to be drawn")
    sheet, told = Sheet(), _told(violations)
    # The drawing of phases needs only the phases of a result, and a prediction has them too.
    phased: Any = prediction
    figure = sheet.figure
    axes: list[Axis] = list(figure.subplots(4, 1, sharex=True, height_ratios=(3.0, 3.0, 1.8, 1.2)))
    top = 0.875 - ROW * len(told)
    figure.subplots_adjust(left=0.085, right=0.985, top=top, bottom=0.06, hspace=0.12)
    last = "sliding / µm" if samples.arms == 1 else "place / µm"
    labels = ("position / µm", "contact force / mN", "voltage / V", last)
    for axis, label in zip(axes, labels, strict=True):
        drawing.prepare(axis, label)
        drawing.shade(axis, phased)
    _courses(axes, samples)
    _planned_voltage(axes[2], planned)
    for limit in _limits(planned.model.rig):
        _draw_limit(axes[limit.axis], limit)
    for axis in axes[:3]:
        drawing.make_room(axis)
        low, high = axis.get_ylim()
        axis.set_ylim(low - BELOW * (high - low), high)
    axes[3].set_xlabel("time / s")
    axes[3].set_xlim(0.0, prediction.duration_s)
    _mark(axes, violations)
    drawing.name_phases(axes[0], phased, 0.0, prediction.duration_s)
    figure.align_ylabels(axes)
    sheet.head(0.085, _title(planned, prediction), _subtitle(prediction), name)
    for row, words in enumerate(told):
        figure.text(0.085, 0.914 - ROW * row, words, fontsize=9, color=BROKEN)
    return sheet.png()


def _courses(axes: Sequence[Axis], samples: Samples) -> None:
    t_s = np.array(samples.t_s)

    def draw(axis: Axis, values: list[float], color: str, label: str, *, dashed: bool) -> None:
        drawing.line(axis, t_s, np.array(values), color, label, dashed=dashed)

    if samples.arms == 2:
        draw(axes[1], samples.second_force_mN, SECOND, "$F_2$ predicted", dashed=False)
        draw(axes[2], samples.second_voltage_V, SECOND, "$u_2$ predicted", dashed=False)
        draw(axes[3], samples.place_um, MEASURED, "$q$ predicted", dashed=False)
        draw(axes[3], samples.place_r_um, REFERENCE, "$q_r$ reference", dashed=True)
        draw(axes[0], samples.second_x_um, SECOND, "$x_2$ predicted", dashed=False)
    draw(axes[0], samples.x_um, MEASURED, "$x$ predicted", dashed=False)
    draw(axes[0], samples.x_r_um, REFERENCE, "$x_r$ reference", dashed=True)
    draw(axes[1], samples.force_mN, MEASURED, "$F$ predicted", dashed=False)
    draw(axes[1], samples.force_r_mN, REFERENCE, "$F_r$ reference", dashed=True)
    draw(axes[2], samples.voltage_V, MEASURED, "$u$ predicted", dashed=False)
    if samples.arms == 1:
        draw(axes[3], samples.sliding_um, MEASURED, "s", dashed=False)
        axes[3].axhline(0.0, color=FAINT, linewidth=0.7, zorder=1)
    else:
        drawing.legend(axes[3], columns=2)
    for axis in axes[:2]:
        drawing.legend(axis, columns=2)


def _planned_voltage(axis: Axis, planned: Planned) -> None:
    """Draw the voltage that the plan expects, if it expects one."""
    curves = getattr(planned.plan, "curves", None)
    if curves is not None:
        t_s, values = np.array(curves.t_s), np.array(curves.voltage_V)
        drawing.line(axis, t_s, values, REFERENCE, "$u$ planned", dashed=True)
    drawing.legend(axis, columns=2)


def _limits(rig: RigFile) -> list[Limit]:
    limits = rig.limits
    return [
        Limit(0, limits.position_max_um, f"{limits.position_max_um:g} µm at most"),
        Limit(0, limits.position_min_um, f"{limits.position_min_um:g} µm at least"),
        Limit(1, limits.force_max_mN, f"{limits.force_max_mN:g} mN at most"),
        Limit(2, limits.voltage_max_V, f"{limits.voltage_max_V:g} V at most"),
        Limit(2, limits.voltage_min_V, f"{limits.voltage_min_V:g} V at least"),
    ]


def _draw_limit(axis: Axis, limit: Limit) -> None:
    low, high = axis.dataLim.intervaly
    span = max(high - low, 1e-9)
    if not low - NEAR * span <= limit.value <= high + NEAR * span:
        return
    axis.axhline(limit.value, color=LIMIT, linewidth=0.9, linestyle=(0, (6, 3)), zorder=1)
    outside = 1.0 if limit.value > low else -1.0
    axis.annotate(
        limit.words,
        (0.995, limit.value),
        xycoords=("axes fraction", "data"),
        xytext=(0, 3.0 * outside),
        textcoords="offset points",
        ha="right",
        va="bottom" if outside > 0.0 else "top",
        fontsize=8,
        color=LIMIT,
    )


def _mark(axes: Sequence[Axis], violations: Sequence[Violation]) -> None:
    """Mark the points at which a limit is exceeded, with the time."""
    marked = [0] * len(axes)
    for violation in violations:
        index = AXIS_OF.get(violation.quantity)
        if index is None:
            continue
        axis, step = axes[index], marked[index]
        late = violation.at_s > LATE * axis.get_xlim()[1]
        marked[index] += 1
        axis.axvline(violation.at_s, color=BROKEN, linewidth=1.0, zorder=3)
        axis.annotate(
            f"{violation.quantity} {violation.value:.3g} {violation.unit}, {violation.at_s:.2f} s",
            (violation.at_s, 0.5),
            xycoords=("data", "axes fraction"),
            xytext=(-4 if late else 4, -11 * step),
            textcoords="offset points",
            ha="right" if late else "left",
            va="center",
            fontsize=8,
            color=BROKEN,
        )


def _told(violations: Sequence[Violation]) -> list[str]:
    told = [violation.message[:150] for violation in violations[:TOLD]]
    if len(violations) > TOLD:
        told.append(f"and {len(violations) - TOLD} more")
    return told


def _title(planned: Planned, prediction: Prediction) -> str:
    kind, outcome = planned.plan.kind, prediction.outcome.replace("_", " ")
    if not planned.plan.feasible:
        return f"{kind}, not feasible"
    return f"{kind}, predicted: {outcome}"


def _subtitle(prediction: Prediction) -> str:
    peaks = prediction.peaks
    words = [
        f"peak {peaks.force_max_mN:.2f} mN",
        f"{peaks.x_min_um:.2f} to {peaks.x_max_um:.2f} µm",
        f"{peaks.voltage_min_V:.2f} to {peaks.voltage_max_V:.2f} V",
        f"{prediction.duration_s:.2f} s",
    ]
    if prediction.cut:
        words.append(prediction.cut)
    return "   ·   ".join(words)
