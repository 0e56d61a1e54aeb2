"""Shared parts of the sections on tracking: plot of a run, and errors as text and numbers."""

from collections.abc import Sequence
from typing import Any

from pincette.plotting import BLUE, GREEN, ORANGE, Axis, label, legend_above, picture
from pincette_study.closed_loop import Errors, Record
from pincette_study.report import Comparison


def percent(quantity: str, paper: float, ours: float, note: str = "") -> Comparison:
    """Compare a relative error with that of the paper."""
    return Comparison(quantity, "%", paper, ours, note)


def listed(values: Sequence[float]) -> str:
    """Return errors as a list of words."""
    return ", ".join(f"{value:.2f} %" for value in values)


def plain(item: Errors) -> dict[str, Any]:
    """Return errors in the form of ``paper.json``."""
    return {name: getattr(item, name) for name in Errors.__slots__}


def traces(seen: Record) -> bytes:
    """Draw position, force, their errors, voltage and sliding function, as in Figs. 9 and 10."""

    def draw(axes: list[Axis]) -> None:
        t = seen.t_s
        axes[0].plot(t, seen.x_um, color=BLUE, label="$x$")
        axes[0].plot(t, seen.x_r_um, color=ORANGE, linestyle="--", label="$x_r$")
        label(axes[0], "", "position / µm")
        legend_above(axes[0])
        axes[1].plot(t, seen.true_force_mN, color=GREEN, label="$F$ true")
        axes[1].plot(t, seen.force_mN, color=BLUE, linewidth=1.0, label="$F$ estimated")
        axes[1].plot(t, seen.force_r_mN, color=ORANGE, linestyle="--", label="$F_r$")
        label(axes[1], "", "force / mN")
        legend_above(axes[1])
        axes[2].plot(t, seen.x_um - seen.x_r_um, color=BLUE)
        label(axes[2], "", "position error / µm")
        axes[3].plot(t, seen.true_force_mN - seen.force_r_mN, color=GREEN)
        label(axes[3], "", "force error / mN")
        axes[4].plot(t, seen.voltage_V, color=BLUE)
        label(axes[4], "time / s", "voltage / V")
        axes[5].plot(t, seen.sliding_um, color=BLUE, label="$s$")
        axes[5].fill_between(
            t, -seen.band_um, seen.band_um, color=ORANGE, alpha=0.25, label="band of $s$"
        )
        label(axes[5], "time / s", "sliding / µm")
        legend_above(axes[5])

    return picture(3, 2, 6.6, draw, sharex=True)
