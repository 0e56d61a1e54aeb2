"""What comes for a loop, and which thread makes the turn that takes it.

The thread that brings a message makes the turn itself, one thread at a time; the program's own
thread makes those that a timer asks for. To hand a message over from one thread to another takes
longer than most steps. This is the pattern of leader and followers: D. C. Schmidt, M. Stal,
H. Rohnert and F. Buschmann, Pattern-Oriented Software Architecture, volume 2, Wiley 2000.
"""

import threading
from collections.abc import Callable
from math import inf
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Generic, TypeVar

Item = TypeVar("Item")

MAX_BATCH = 1000
"""Items of a turn, however many are waiting: then the clock is read again."""
SAME_S = 2e-5
"""Two times that differ by less are one timer, read twice."""


class Inbox(Generic[Item]):
    """Items in the order in which they came, and turns of one thread at a time."""

    def __init__(self, turn: Callable[[], float]) -> None:
        """``turn`` makes a turn, and returns for how many seconds nothing else is to be done.

        Before ``run`` and after it nobody but its caller makes turns.
        """
        self._turn = turn
        self._items: SimpleQueue[Item] = SimpleQueue()
        self._turning = threading.Lock()
        """Held for a turn; by the program's own thread until it waits."""
        self._turning.acquire()
        self._nudges: SimpleQueue[None] = SimpleQueue()
        """Wake that thread,"""
        self._wakes_s = inf
        """which wakes by itself then."""
        self._stopped = False
        self._failure: Exception | None = None

    def bring(self, item: Item) -> None:
        """Take an item, and make the turn here unless another thread is at one.

        That one looks for what has come meanwhile before it goes.
        """
        self._items.put(item)
        while not self._stopped:
            if not self._turning.acquire(blocking=False):
                return
            try:
                self._nudge(monotonic() + self._turn())
            except Exception as error:  # noqa: BLE001  the program's own thread raises it
                self._failure = error
                self.stop()
            finally:
                self._turning.release()
            if self._items.empty():
                return

    def leave(self, item: Item) -> None:
        """Take an item for a turn of the program's own thread: more may come until then."""
        self._items.put(item)
        self._nudge(-inf)

    def take(self, taker: Callable[[Item], None]) -> None:
        """Give all that is there to ``taker``; for a turn."""
        items = self._items
        for _ in range(MAX_BATCH):
            if items.empty():  # which is no guess, since only who is at a turn takes from it
                return
            taker(items.get_nowait())

    def empty(self) -> bool:
        """Whether nothing has come since."""
        return self._items.empty()

    def stop(self) -> None:
        """End ``run``; may be called from a signal handler."""
        self._stopped = True
        self._nudges.put(None)

    def run(self) -> None:
        """Make turns until stopped; raises what a turn has raised in any thread."""
        while not self._stopped:
            self._wait(self._turn())
        if self._failure is not None:
            raise self._failure

    def _wait(self, wait_s: float) -> None:
        """Leave the turns to others, until a timer asks for one or somebody nudges."""
        self._wakes_s = monotonic() + wait_s
        self._turning.release()
        try:
            if self._items.empty():
                self._nudges.get(timeout=wait_s)
        except Empty:
            pass
        finally:
            self._turning.acquire()

    def _nudge(self, wakes_s: float) -> None:
        """Wake the program's own thread where it would wake after that time."""
        if wakes_s < self._wakes_s - SAME_S:
            self._wakes_s = wakes_s
            self._nudges.put(None)
