"""The threads of a supervisor's jobs, step by step: each waits until the test lets it continue.

A job's thread waits where it expects a message and before it sends a request. A test lets time
pass, and acts in between.
"""

import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from time import monotonic
from typing import Any, TypeVar

from pincette_supervisor.jobs.job import LiveJob
from tests.support.virtual_rig import VirtualRig

GUARD_S, LOOK_S = 30.0, 0.01
"""Wall-clock limit, in s: a thread that does not reach its next wait has hung."""


T = TypeVar("T")


class KilledError(BaseException):
    """The supervisor was killed; nothing that it would still do may have an effect."""


class Steps:
    """Points at which the threads of jobs wait."""

    def __init__(self, rig: VirtualRig) -> None:
        self.rig = rig
        self.guard_s = GUARD_S
        """Longest wall-clock time that a job's thread may compute."""
        self.killed = self.free = False
        """True if no thread waits any more and time passes."""
        self.threads: set[threading.Thread] = set()
        self._turn = threading.Condition()
        self._resting: set[int] = set()
        self._looks = 0

    def rest(self) -> None:
        """Wait in a job's thread until the test lets it continue; raises KilledError."""
        thread = threading.current_thread()
        if self.killed:
            raise KilledError
        if thread not in self.threads:
            return
        if self.free:
            self.rig.tick()
            return
        with self._turn:
            self._resting.add(thread.ident or 0)
            self._turn.notify_all()
            looks = self._looks
            while self._looks == looks and not self.killed and not self.free:
                self._turn.wait(LOOK_S)
            self._resting.discard(thread.ident or 0)
        if self.killed:
            raise KilledError

    def look(self) -> None:
        """Let every waiting thread continue to its next wait, or to its end."""
        self.settle()
        with self._turn:
            self._looks += 1
            self._resting.clear()
            self._turn.notify_all()
        self.settle()

    def settle(self) -> None:
        """Wait until all threads wait or have ended."""
        begun_at = monotonic()
        with self._turn:
            while any(t.is_alive() and t.ident not in self._resting for t in tuple(self.threads)):
                assert monotonic() - begun_at < self.guard_s, "a job's thread hangs"
                self._turn.wait(LOOK_S)

    def ended(self) -> None:
        """Wake the settling thread because the calling thread of a job is about to end."""
        with self._turn:
            self._resting.add(threading.get_ident())
            self._turn.notify_all()

    def pass_(self, ticks: int = 1) -> None:
        """Let time pass, with every tick visible to the supervisor."""
        for _ in range(ticks):
            self.rig.tick()
            self.look()


class Done(threading.Event):
    """An event; waiting for it lets virtual time pass."""

    def __init__(self, steps: Steps) -> None:
        super().__init__()
        self._steps = steps

    def wait(self, timeout: float | None = None) -> bool:
        until_s = self._steps.rig.now_s + (timeout or 0.0)
        while not self.is_set() and self._steps.rig.now_s < until_s and not self._steps.free:
            self._steps.pass_()
        return self.is_set()


class SteppedLock:
    """A reentrant lock. A test that waits for it lets the thread of a job that has it continue."""

    def __init__(self, steps: Steps) -> None:
        self._lock, self._steps = threading.RLock(), steps

    def __enter__(self) -> None:
        of_job = threading.current_thread() in self._steps.threads
        while not self._lock.acquire(blocking=of_job):
            self._steps.look()

    def __exit__(self, *_ended: object) -> None:
        self._lock.release()


class SteppedJob(LiveJob):
    """A job that stops at each of its waits until the test continues it."""

    def __init__(self, *args: Any, steps: Steps) -> None:
        super().__init__(*args)
        self.done, self._steps = Done(steps), steps

    def wait(self, timeout_s: float) -> None:  # noqa: ARG002  it waits for a look
        self._steps.rest()


class AtOnce(Executor):
    """Executor that runs submitted calls in the caller's thread, so that the same calls give the
    same results."""

    def __init__(self, *_given: object, **_named: object) -> None:
        super().__init__()

    def submit(self, fn: Callable[..., T], /, *args: Any, **named: Any) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **named))
        except BaseException as error:  # noqa: BLE001  the future's caller is told of it
            future.set_exception(error)
        return future
