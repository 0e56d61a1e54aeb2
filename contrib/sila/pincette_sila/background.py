"""Event loop in its own thread, which runs the requests that SiLA's threads send to the
supervisor.
"""

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import CancelledError
from typing import Any, TypeVar

from pincette_sila.errors import CommandError

T = TypeVar("T")


class Background:
    """Runs coroutines until it is closed, which cancels all of them."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._closing = False
        self._accepting = threading.Lock()
        """Held while a coroutine is submitted, so that none arrives after the last cancel."""
        self._thread = threading.Thread(target=self._loop.run_forever, name="client", daemon=True)
        self._thread.start()

    def call(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine and wait for its end; raises CommandError if the server ends first."""
        words = "this SiLA server is stopping; a motion that has started continues without it"
        with self._accepting:
            if self._closing:
                coroutine.close()
                raise CommandError("SupervisorUnreachable", words)
            submitted = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return submitted.result()
        except CancelledError as error:
            raise CommandError("SupervisorUnreachable", words) from error

    def begin(self, coroutine: Coroutine[Any, Any, None]) -> None:
        """Run a coroutine concurrently with all others."""
        asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    def close(self) -> None:
        """Cancel running coroutines, and end the thread."""
        with self._accepting:
            if self._closing:
                return
            self._closing = True
        asyncio.run_coroutine_threadsafe(self._cancel(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _cancel(self) -> None:
        others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)
