"""``python -m pincette_study.two_arms.acceptance`` tests two arms with the real services.

Random pairs are tested one after the other, each with its own rig files. The jobs are planned,
checked and evaluated by the supervisor's functions and played by the four services over the
instruments' real protocols, in lockstep in one process. The errors are true errors; those of the
force are in per cent of the height of its path.
"""

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from pincette.api.pairs import PairResult
from pincette.config import RigFile, read_rig
from pincette.records.columns import Columns
from pincette_study import printed
from pincette_study.beyond.tracks import CLASSES
from pincette_study.two_arms.pair_desk import PairDesk
from pincette_study.two_arms.rig_files import write_pair
from pincette_study.two_arms.trials import FIRM_MN, FORCE_MN, FORCE_PP_MN, MOST_OFF_UM

CONSOLE = Console(highlight=False)


@dataclass(frozen=True, slots=True)
class Figure:
    """Limits of a result: for the median and the worst value."""

    name: str
    unit: str
    median: float
    worst: float


FIGURES = (
    Figure("position at 0.5 Hz, 20 ms", "%", 0.3, 0.6),
    Figure("force at 0.3 Hz, 20 ms", "%", 1.5, 3.0),
    Figure("position at 2 Hz, 20 ms", "%", 0.5, 1.0),
    Figure("force at 1.3 Hz, 20 ms", "%", 2.0, 4.0),
    Figure("position at 10 Hz, 1 ms", "%", 1.0, 2.0),
    Figure("force at 7 Hz, 1 ms", "%", 2.5, 5.0),
    Figure("centre: moved", "µm", 0.5, 0.5),
)
"""Limits of the acceptance. The medians are specified; where no worst value is specified, it is
twice the median."""
SLOW_TRACKS = ((0.5, 5, 0.3, 3), (2.0, 10, 1.3, 7))
FAST_TRACK = (10.0, 20, 7.0, 14)
"""Frequency in Hz and number of cycles of the position path, then of the force path."""


@dataclass(frozen=True, slots=True)
class PairFigures:
    """Results of one pair, in the order of ``FIGURES``."""

    hysteresis: str
    number: int
    values: tuple[float, ...]


def run_pair(base: Path, folder: Path, drawn: tuple[str, int]) -> PairFigures:
    """Draw, teach, track at three speeds and centre; raises StudyError if a job fails."""
    hysteresis, number = drawn
    slow, fast = write_pair(base, hysteresis, number, folder)
    values: list[float] = []
    for path, tracks in ((slow, SLOW_TRACKS), (fast, (FAST_TRACK,))):
        desk = PairDesk(read_rig(path))
        desk.stroke()
        for track in tracks:
            values += _tracked(desk, *track)
    chance = np.random.default_rng([1, number])
    off_um = float(chance.uniform(-MOST_OFF_UM, MOST_OFF_UM))
    desk = PairDesk(_off(read_rig(slow), off_um))
    desk.stroke()
    grip = {"kind": "grip", "centre": True, "force_mN": FORCE_MN, "hold_s": 0.5}
    _, table = desk.play(grip)
    values.append(moved_um(table))
    return PairFigures(hysteresis, number, tuple(values))


def _tracked(
    desk: PairDesk, place_hz: float, place_cycles: int, force_hz: float, force_cycles: int
) -> tuple[float, float]:
    place = {"pp_um": printed.X_PP_UM, "frequency_hz": place_hz, "cycles": place_cycles}
    force = {"mean_mN": FORCE_MN, "pp_mN": FORCE_PP_MN}
    force |= {"frequency_hz": force_hz, "cycles": force_cycles}
    result, _ = desk.play({"kind": "track", "place": place, "force": force})
    assert isinstance(result, PairResult)
    assert result.true_place_um is not None
    assert result.true_force_mN is not None
    return (
        100.0 * result.true_place_um.rmse / printed.X_PP_UM,
        100.0 * result.true_force_mN.rmse / FORCE_PP_MN,
    )


def _off(rig: RigFile, off_um: float) -> RigFile:
    """Return the rig with its part away from the planned position."""
    simulation = rig.simulation
    assert simulation is not None
    assert simulation.second is not None
    second_um = simulation.second.bead_contact_um
    assert second_um is not None
    second = simulation.second.model_copy(update={"bead_contact_um": second_um - off_um})
    at_um = simulation.bead_contact_um + off_um
    update = {"bead_contact_um": at_um, "second": second}
    return rig.model_copy(update={"simulation": simulation.model_copy(update=update)})


def moved_um(table: Columns) -> float:
    """Return the largest motion of the part until both arms held it with ``FIRM_MN``, in µm."""
    names = "true_part_um", "true_force_mN", "true_second_force_mN"
    places, first, second = (np.array(table[name], dtype=np.float64) for name in names)
    held = int(np.argmax(np.minimum(first, second) >= FIRM_MN))
    return float(np.max(np.abs(places[: held + 1] - places[0])))


def run_pairs(base: Path, pairs: int, folder: Path, workers: int = 1) -> Iterator[PairFigures]:
    """Yield the results of this number of pairs of each class, one after the other."""
    drawn = [(hysteresis, number) for number in range(pairs) for hysteresis in CLASSES]
    one = partial(run_pair, base, folder)
    if workers == 1:
        yield from map(one, drawn)
        return
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        yield from pool.map(one, drawn)


def main(
    rig: Annotated[Path, typer.Argument(help="rig file around which random pairs are drawn")],
    pairs: Annotated[int, typer.Option(min=1, help="pairs of each class of hysteresis")] = 10,
    workers: Annotated[int, typer.Option(min=1, help="processes")] = 1,
    keep: Annotated[Path | None, typer.Option(help="folder for the rig files")] = None,
) -> None:
    """Print the results of each pair, then median and worst value of each with its limits."""
    with TemporaryDirectory() as made:
        folder = Path(made) if keep is None else keep
        folder.mkdir(parents=True, exist_ok=True)
        found: list[PairFigures] = []
        for one in run_pairs(rig, pairs, folder, workers):
            found.append(one)
            shown = " ".join(f"{value:6.3f}" for value in one.values)
            CONSOLE.print(f"{one.hysteresis:9} seed {one.number:2}: {shown}")
    for line in report(found):
        CONSOLE.print(line)


def report(found: list[PairFigures]) -> Iterator[str]:
    """Print a line for each result: for all pairs, and for each class."""
    for place, figure in enumerate(FIGURES):
        of_class = [
            f"{name} {_text([one.values[place] for one in found if one.hysteresis == name])}"
            for name in CLASSES
            if any(one.hysteresis == name for one in found)
        ]
        yield (
            f"{figure.name}: {_text([one.values[place] for one in found])} {figure.unit}, "
            f"target {figure.median:g} ({figure.worst:g}); {', '.join(of_class)}"
        )


def _text(values: list[float]) -> str:
    """Return the median, and the worst value in brackets."""
    return f"{median(values):.2f} ({max(values):.2f})"


if __name__ == "__main__":
    typer.run(main)
