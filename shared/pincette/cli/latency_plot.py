"""A picture of how late wake-ups were: what share of them was later than a time."""

from pincette.latency.histogram import NS_PER_S, Distribution, first_ns
from pincette.latency.rule import LATE_SHARE, LATEST_SHARE, TAIL
from pincette.paper.drawing import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    RED,
    Axis,
    label,
    legend,
    picture,
)
from pincette.runtime.measuring.machine import Findings

COLOURS = (BLUE, ORANGE, GREEN, RED, "#6b5b95")
HEIGHT_IN = 4.6


def plot(found: Findings) -> bytes:
    """Draw every period, the hops, and the limits of the rule for the shortest; a PNG."""

    def lines(axes: list[Axis]) -> None:
        (axis,) = axes
        for measured, colour in zip(found.wake_ups, COLOURS, strict=False):
            name = f"wake-ups each {1e3 * measured.period_s:g} ms"
            _draw(axis, measured.lateness, colour, name)
        _draw(axis, found.hop, FAINT, "hop over the bus")
        shortest_s = min(measured.period_s for measured in found.wake_ups)
        for share, style in ((LATE_SHARE, "--"), (LATEST_SHARE, ":")):
            name = f"{share:g} of {1e3 * shortest_s:g} ms"
            axis.axvline(1e3 * share * shortest_s, color=INK, linestyle=style, label=name)
        axis.axhline(1.0 - TAIL, color=FAINT, linewidth=0.8)
        axis.set_xscale("log")
        axis.set_yscale("log")
        label(axis, "late by more than, in ms", "share of wake-ups", found.kernel)
        legend(axis, "lower left")

    return picture(1, 1, HEIGHT_IN, lines)


def _draw(axis: Axis, told: Distribution, colour: str, name: str) -> None:
    ends_ms: list[float] = []
    shares: list[float] = []
    left = told.count
    for bucket, count in zip(told.buckets, told.counts, strict=True):
        ends_ms.append(1e3 * first_ns(bucket + 1) / NS_PER_S)
        shares.append(left / told.count)
        left -= count
    axis.plot(ends_ms, shares, color=colour, label=name, drawstyle="steps-pre")
