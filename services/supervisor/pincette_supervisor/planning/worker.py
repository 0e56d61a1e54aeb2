"""Process for work that occupies a processor for more than a moment.

In the supervisor itself, the work would hold the interpreter's lock, and an emergency stop would
have to wait for it.
"""

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from typing import Any, Protocol, TypeVar

from pincette.engine.realtime.os_scheduling import lower_priority

log = logging.getLogger("pincette")
UNUSED_S = 600.0
"""Time after which an unused process ends, in s, which frees its 60 to 120 MB."""
SEMAPHORES = "/dev/shm"
"""Folder in memory where the system stores semaphores, which the queue to the process needs."""
A = TypeVar("A")
R = TypeVar("R")


class Runner(Protocol):
    """Function that calls a pure function of a module, here or in another process."""

    def __call__(self, work: Callable[[A], R], argument: A, /) -> R:
        """Return the result of the function; raise its errors."""
        ...


def run_here(work: Callable[[A], R], argument: A, /) -> R:
    """Call a function in this process."""
    return work(argument)


class Worker:
    """One process, which ends when unused for some time; safe to use from several threads."""

    def __init__(self, *ahead: Callable[[Any], Any]) -> None:
        self._ahead = ahead
        """Functions whose modules the process loads before it lowers its priority."""
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self._first: Future[int] | None = None
        """Future with the number of the process, done once the process has begun."""
        self._callers = 0
        """Number of threads that wait for a result."""
        self._end: threading.Timer | None = None
        """Timer that ends the process once it has not been used for ``UNUSED_S``."""

    def begin(self) -> None:
        """Start the process without waiting for it; otherwise it starts when it is first needed.

        The imports of the process take seconds of processor time, and much longer while other
        programs use the processor. If the process cannot start, the error is logged, and the start
        is retried when it is needed. Everything else works without it.
        """
        try:
            with self._used():
                self._begun()
        except OSError as error:
            log.error("%s", error.strerror)

    @property
    def pid(self) -> int:
        """Return the number of the process; 0 before it has started."""
        first = self._first
        if first is None or not first.done() or first.exception() is not None:
            return 0
        return first.result()

    def run(self, work: Callable[[A], R], argument: A) -> R:
        """Call a pure function in the process; its errors are raised here."""
        with self._used():
            try:
                return self._begun().submit(work, argument).result()
            except BrokenProcessPool:
                self.close()  # the process was killed: try once more
                return self._begun().submit(work, argument).result()

    def run_somewhere(self, work: Callable[[A], R], argument: A) -> R:
        """Call a pure function in the process, or here if the process cannot do it."""
        try:
            return self.run(work, argument)
        except Exception:  # an error of the function itself is raised again here
            log.exception(
                "a worker process of the supervisor failed; the supervisor does its work itself"
            )
            return work(argument)

    @contextmanager
    def _used(self) -> Generator[None]:
        """Keep the process alive within the ``with`` block, and for ``UNUSED_S`` afterwards."""
        with self._lock:
            self._callers += 1
            if self._end is not None:
                self._end.cancel()
        try:
            yield
        finally:
            with self._lock:
                self._callers -= 1
                if not self._callers:
                    self._end = threading.Timer(UNUSED_S, self.close, kwargs={"if_unused": True})
                    self._end.daemon = True
                    self._end.start()

    def _begun(self) -> ProcessPoolExecutor:
        with self._lock:
            if self._pool is None:
                fresh = multiprocessing.get_context("spawn")
                try:
                    pool = ProcessPoolExecutor(
                        1, mp_context=fresh, initializer=_begin, initargs=self._ahead
                    )
                    self._first = pool.submit(os.getpid)
                except OSError as error:
                    raise OSError(
                        error.errno,
                        f"the process that predicts motions cannot start ({error}): it needs "
                        f"room in {SEMAPHORES}, memory and file handles",
                    ) from error
                self._pool = pool
            return self._pool

    def close(self, *, if_unused: bool = False) -> None:
        """End the process and its work; with ``if_unused``, only if no thread waits for a
        result."""
        with self._lock:
            if if_unused and self._callers:
                return
            if self._end is not None:
                self._end.cancel()
            pid, pool = self.pid, self._pool
            self._pool = self._first = None
        if pool is not None:
            if pid:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGTERM)
            pool.shutdown(cancel_futures=True)


def _begin(*_ahead: Callable[[Any], Any]) -> None:
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # the supervisor also gets this signal, and ends this process
    lower_priority()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process with its parent: a killed supervisor does not end its children."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(0)
