"""Charts of age, lateness and CPU use by number of rigs and by number of subscribers."""

from collections.abc import Sequence
from pathlib import Path

from pincette.plotting import BLUE, GREEN, ORANGE, RED, Axis, label, legend, picture
from tests.bench.realtime.measured import Measured

COLOURS = (BLUE, ORANGE, GREEN, RED)
HEIGHT_IN = 7.0


def draw(path: Path, by_rigs: Sequence[Measured], by_listeners: Sequence[Measured]) -> None:
    """Draw the chart: rigs on the left, subscribers on the right."""

    def lines(axes: list[Axis]) -> None:
        rigs = [one.rigs for one in by_rigs]
        listeners = [one.listeners for one in by_listeners]
        for column, (places, scales, name) in enumerate(
            (
                (rigs, by_rigs, "rigs"),
                (listeners, by_listeners, "listeners to all keys of one rig"),
            )
        ):
            _durations(axes[column], places, scales, name)
            _processors(axes[2 + column], places, scales, name)

    path.write_bytes(picture(2, 2, HEIGHT_IN, lines))


def _durations(axis: Axis, places: Sequence[int], scales: Sequence[Measured], name: str) -> None:
    for share, colour in zip(scales[0].age_ms, COLOURS, strict=True):
        ages_ms = [one.age_ms[share] for one in scales]
        late_ms = [one.lateness_ms[share] for one in scales]
        axis.plot(places, ages_ms, color=colour, marker="o", label=f"age {share}")
        axis.plot(places, late_ms, color=colour, marker=".", linestyle=":", label=f"late {share}")
    axis.set_yscale("log")
    label(axis, name, "ms")
    legend(axis)


def _processors(axis: Axis, places: Sequence[int], scales: Sequence[Measured], name: str) -> None:
    for program, colour in zip(scales[0].cores, COLOURS, strict=False):
        axis.plot(places, [one.cores[program] for one in scales], color=colour, label=program)
    whole = [sum(one.cores.values()) for one in scales]
    axis.plot(places, whole, color="black", marker="o", label="all")
    label(axis, name, "processors kept busy")
    legend(axis)
