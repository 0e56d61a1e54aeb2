"""``python -m pincette_study.two_arms`` identifies random pairs and tests the law of two arms.

Each pair takes about two minutes on one core, mostly for the run at 1 ms and the identification of
both arms.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from pincette.cli import opened
from pincette_study.beyond.tracks import CLASSES
from pincette_study.two_arms.pairs import TaughtPair, taught_pair
from pincette_study.two_arms.trials import CASES, MOST_OFF_UM, centre, track

CONSOLE = Console(highlight=False)
Figures = tuple[tuple[str, float], ...]
"""Results of one trial: names with unit, and values."""


def run(
    rig: Annotated[Path, typer.Argument(help="rig file around which random pairs are drawn")],
    pairs: Annotated[int, typer.Option(min=1, help="pairs of each class of hysteresis")] = 1,
) -> None:
    """Print the median and the worst value of every result."""
    base = opened(rig)
    found: dict[str, list[Figures]] = {}
    for number in range(pairs):
        for hysteresis in CLASSES:
            CONSOLE.print(f"pair {number + 1} of {pairs}: {hysteresis}")
            pair = taught_pair(base, hysteresis, number)
            for what, trial in _trials(pair):
                found.setdefault(what, []).append(trial())
    for what, each in found.items():
        CONSOLE.print(f"{what}: {_text(each)}", markup=False)


def _trials(pair: TaughtPair) -> Sequence[tuple[str, Callable[[], Figures]]]:
    def followed(place: int, *, dry_run: bool) -> Figures:
        one = track(pair, CASES[place], dry_run=dry_run)
        return (
            ("position %", one.position_percent),
            ("force %", one.force_percent),
            ("between both forces mN", one.disagreement_mN),
        )

    def centred() -> Figures:
        chance = np.random.default_rng([1, pair.number])
        one = centre(pair, float(chance.uniform(-MOST_OFF_UM, MOST_OFF_UM)))
        return (("moved µm", one.moved_um),)

    return (
        *((case.name, lambda at=at: followed(at, dry_run=False)) for at, case in enumerate(CASES)),
        (CASES[0].name + ", after a dry run", lambda: followed(0, dry_run=True)),
        ("centre", centred),
    )


def _text(found: Sequence[Figures]) -> str:
    """Return the median, and the worst value in brackets."""
    columns = zip(*found, strict=True)
    return ", ".join(
        f"{column[0][0]} {median(value for _, value in column):.2f} "
        f"({max(value for _, value in column):.2f})"
        for column in columns
    )


if __name__ == "__main__":
    typer.run(run)
