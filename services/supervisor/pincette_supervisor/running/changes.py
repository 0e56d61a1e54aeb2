"""Coroutines that wait for a job, woken from whichever thread changed it."""

import asyncio
import threading
from collections.abc import Callable


class Changes:
    """Wakes coroutines that wait for a job, from whichever thread changed it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: set[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = set()

    def tell(self) -> None:
        """Wake all who wait."""
        with self._lock:
            for loop, event in self._waiting:
                loop.call_soon_threadsafe(event.set)

    async def wait(self, over: Callable[[], bool], timeout_s: float) -> None:
        """Return when ``over`` is true, which is looked at after each change, or in time."""
        event = asyncio.Event()
        entry = (asyncio.get_running_loop(), event)
        with self._lock:
            self._waiting.add(entry)
        try:
            async with asyncio.timeout(timeout_s):
                while not over():
                    await event.wait()
                    event.clear()
        except TimeoutError:
            return
        finally:
            with self._lock:
                self._waiting.discard(entry)
