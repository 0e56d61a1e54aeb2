"""Many cases, one after the other or on several cores: the same numbers either way."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import TypeVar

from pincette.batch.cases import Case, Run
from pincette.batch.composed import play_composed
from pincette.batch.followed import program_objection, rig_objection
from pincette.batch.kernel.lane import Ending
from pincette.batch.lanes import play_lane
from pincette.batch.prepared import PreparedRig, prepare_rig
from pincette.compiling import available
from pincette.config import RigFile

Kept = TypeVar("Kept")
Progress = Callable[[int, int], None]
"""Takes how many cases are done, and how many there are."""

Known = dict[int, tuple[RigFile, PreparedRig | None]]
"""By the identity of a rig file, which is kept so that no other one gets it."""

CHUNKS = 8
"""For each process; the last ones are then not waited for long."""


def whole(_case: Case, run: Run) -> Run:
    """Keep everything of a run."""
    return run


def play_all(
    cases: Sequence[Case],
    *,
    keep: Callable[[Case, Run], Kept] = whole,
    workers: int = 1,
    again: bool = True,
    progress: Progress | None = None,
) -> list[Kept]:
    """Play every case; what is kept of each, in their order.

    Without the compiler, and where the kernel does not follow a case, the composed loop plays it:
    the same numbers, later.

    Parameters
    ----------
    keep
        What is kept of a run; with several processes a function of a module.
    workers
        Processes; with one, everything is done in this one.
    again
        Whether the composed loop plays a case again that the kernel follows up to where a guard or
        a limit acts. Without, ``Run`` ends there.

    Raises
    ------
    ConfigError
        Where a rig file describes no simulated rig in lockstep.
    ValueError
        Where ``workers`` is below 1, or a law cannot be made.
    """
    if workers < 1:
        raise ValueError(f"workers = {workers}: at least 1 process is wanted")
    played = partial(_played, keep=keep, again=again)
    kept: list[Kept] = []
    for some in _results(cases, played, workers):
        kept += some
        if progress is not None:
            progress(len(kept), len(cases))
    return kept


def _results(
    cases: Sequence[Case], played: Callable[[Sequence[Case]], list[Kept]], workers: int
) -> Iterator[list[Kept]]:
    size = max(1, len(cases) // (CHUNKS * workers))
    chunks = [cases[at : at + size] for at in range(0, len(cases), size)]
    if workers == 1 or len(chunks) < 2:
        yield from map(played, chunks)
        return
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        yield from pool.map(played, chunks)


def _played(cases: Iterable[Case], *, keep: Callable[[Case, Run], Kept], again: bool) -> list[Kept]:
    known: Known = {}
    return [keep(case, _play(case, known, again=again)) for case in cases]


def _play(case: Case, known: Known, *, again: bool) -> Run:
    prepared = _prepared(case.rig, known)
    if prepared is None or program_objection(case.program):
        return play_composed(case)
    run = play_lane(prepared, case)
    return play_composed(case) if again and run.ending is not Ending.DONE else run


def _prepared(rig: RigFile, known: Known) -> PreparedRig | None:
    """The rig as the kernel has it, made once; None where the kernel does not follow it."""
    if id(rig) not in known:
        followed = available() and not rig_objection(rig)
        known[id(rig)] = rig, prepare_rig(rig) if followed else None
    return known[id(rig)][1]
