"""Where the pieces of a batch are computed: here, in local processes, or by any executor."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import nullcontext
from multiprocessing import get_context
from typing import TypeVar

Piece = TypeVar("Piece")
Result = TypeVar("Result")


def checked_workers(workers: int) -> int:
    """The number of workers; raises ValueError where it is below 1."""
    if workers < 1:
        raise ValueError(f"workers = {workers}: at least 1 process is wanted")
    return workers


def in_order(
    compute: Callable[[Piece], Result],
    pieces: Sequence[Piece],
    workers: int,
    executor: Executor | None = None,
) -> Iterator[Result]:
    """Results of all pieces, in their order; what is not begun is cancelled when nobody waits.

    Parameters
    ----------
    compute
        A function of a module, or a partial of one, so that another process can load it.
    workers
        Local processes where there is no executor; with one, everything is computed here.
    executor
        Takes the pieces instead, as ``concurrent.futures`` has it; it is not shut down.
    """
    if executor is None and (workers == 1 or len(pieces) < 2):
        yield from map(compute, pieces)
        return
    local = ProcessPoolExecutor(workers, get_context("spawn")) if executor is None else None
    with local or nullcontext():
        pool = local or executor
        assert pool is not None
        futures = [pool.submit(compute, piece) for piece in pieces]
        try:
            for future in futures:
                yield future.result()
        finally:
            for future in futures:
                future.cancel()
