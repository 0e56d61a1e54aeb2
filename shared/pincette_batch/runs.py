"""Many cases, one after the other, on several cores or on a cluster: the same numbers."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import TypeVar

from pincette.config import RigFile
from pincette_batch.cases import Case, Run
from pincette_batch.compiling import available
from pincette_batch.composed import play_composed
from pincette_batch.executors import checked_workers, in_order
from pincette_batch.followed import program_objection, rig_objection
from pincette_batch.kernel.lane import Ending
from pincette_batch.lanes import play_lane
from pincette_batch.prepared import PreparedRig, prepare_rig

Kept = TypeVar("Kept")
Progress = Callable[[int, int], None]
"""Takes how many cases are done, and how many there are."""

Known = dict[int, tuple[RigFile, PreparedRig | None]]
"""By the identity of a rig file, which is kept so that no other one gets it."""

PIECES = 8
"""For each worker, so that the last ones are not waited for long."""


def whole(_case: Case, run: Run) -> Run:
    """Keep everything of a run."""
    return run


def play_all(
    cases: Sequence[Case],
    *,
    keep: Callable[[Case, Run], Kept] = whole,
    workers: int = 1,
    executor: Executor | None = None,
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
        Processes; with one, everything is done in this one. With an executor: how many it has.
    executor
        Plays the cases instead of local processes, for instance that of a Dask cluster.
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
    size = max(1, len(cases) // (PIECES * checked_workers(workers)))
    pieces = [cases[at : at + size] for at in range(0, len(cases), size)]
    kept: list[Kept] = []
    for some in in_order(partial(_played, keep=keep, again=again), pieces, workers, executor):
        kept += some
        if progress is not None:
            progress(len(kept), len(cases))
    return kept


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
