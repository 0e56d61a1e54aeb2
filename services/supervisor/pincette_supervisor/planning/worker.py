"""A process for what keeps a processor for longer than a moment.

Worked out in the supervisor itself it would hold the interpreter's lock, for which an emergency
stop would have to wait in line.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from typing import TypeVar

from pincette.runtime.priority import stand_back

A = TypeVar("A")
R = TypeVar("R")


class Worker:
    """One process, begun when it is first needed; safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self.pid = 0
        """Of the process, once it has begun."""

    def run(self, work: Callable[[A], R], argument: A) -> R:
        """Call a pure function of a module there; what it raises is raised here."""
        try:
            return self._begun().submit(work, argument).result()
        except BrokenProcessPool:
            self.close()  # somebody has killed it: a second time that is for the caller to know
            return self._begun().submit(work, argument).result()

    def _begun(self) -> ProcessPoolExecutor:
        with self._lock:
            if self._pool is None:
                fresh = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(1, mp_context=fresh, initializer=_begin)
                self.pid = self._pool.submit(os.getpid).result()
            return self._pool

    def close(self) -> None:
        """End the process, and what it is at."""
        with self._lock:
            pool, self._pool = self._pool, None
        if pool is not None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGTERM)
            pool.shutdown(cancel_futures=True)


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the supervisor hears it too, and says when
    stand_back()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A supervisor that is killed takes nothing along by itself."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(0)
