"""Calls in a few threads of their own, shared by the requests that wait for one."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, TypeVar

T = TypeVar("T")
THREADS = 4
LEAST_S = 0.3
"""Time left for a stop that had to wait for others, so that each reply comes within 1.5 s."""


class SharedTurns(Generic[T]):
    """Makes calls in threads that nothing else uses.

    Requests that arrive while all threads are busy share the next call, which begins after all of
    them have arrived. So any number of requests costs no more than these threads.
    """

    def __init__(self, name: str) -> None:
        """``name``: prefix of the names of the threads."""
        self._threads = ThreadPoolExecutor(THREADS, thread_name_prefix=name)
        self._slots = asyncio.Semaphore(THREADS)
        self._next: dict[str, asyncio.Task[T]] = {}
        """Calls that wait for a thread, by what they do."""

    async def call(self, perform: Callable[[float], T], what: str = "") -> T:
        """Return what ``perform`` returns; it is called with the time that it had to wait, in s.

        ``what``: requests that want something else do not share a call.
        """
        loop = asyncio.get_running_loop()
        task = self._next.get(what)
        if task is None or task.done() or task.get_loop() is not loop:
            task = self._next[what] = loop.create_task(self._in_turn(perform, what))
            task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return await asyncio.shield(task)

    async def _in_turn(self, perform: Callable[[float], T], what: str) -> T:
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        async with self._slots:
            self._next.pop(what, None)
            return await loop.run_in_executor(self._threads, perform, loop.time() - begun_s)

    def close(self) -> None:
        """End the threads, once their calls have returned."""
        self._threads.shutdown()
