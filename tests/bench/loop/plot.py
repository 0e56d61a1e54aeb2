"""Chart of the tick lengths of each contestant: share of ticks longer than a given length."""

from collections.abc import Sequence
from pathlib import Path

from pincette.plotting import BLUE, GREEN, ORANGE, RED, Axis, label, legend, picture
from tests.bench.loop.contestant import Contestant

COLOURS = (BLUE, "#17a2b8", ORANGE, GREEN, RED, "#6b5b95", "#7a8b3f", "#b58900", "#555", "#000")
HEIGHT_IN = 4.0


def draw(path: Path, contestants: Sequence[Contestant]) -> None:
    """Draw the ticks of all blocks."""

    def lines(axes: list[Axis]) -> None:
        (axis,) = axes
        for contestant, colour in zip(contestants, COLOURS, strict=True):
            ticks_ms = sorted(
                1e3 * tick_s for block in contestant.blocks for tick_s in block.ticks_s
            )
            count = len(ticks_ms)
            shares = [(count - place) / count for place in range(count)]
            axis.plot(ticks_ms, shares, color=colour, label=contestant.name, drawstyle="steps-pre")
        axis.set_xscale("log")
        axis.set_yscale("log")
        label(axis, "length of a tick in ms", "share of ticks that take longer")
        legend(axis)

    path.write_bytes(picture(1, 1, HEIGHT_IN, lines))
