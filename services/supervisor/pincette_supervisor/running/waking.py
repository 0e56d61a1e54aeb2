"""Time as far as this program was there to see it pass."""

import threading
from collections.abc import Callable
from time import monotonic

LOOK_S = 0.05
LOOK_COUNTS_S = 0.1
"""The most that one look counts for."""
JOIN_S = 2.0


class Waking:
    """A clock that stands still while its program does.

    One that was stopped, or that a busy machine did not run, finds everybody silent when it wakes,
    and hears in its next moments what was said meanwhile. By this clock nobody was silent then.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._looked = clock(), 0.0
        """When, and what had passed by then; one value, which threads may read at any time."""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._work, name="waking", daemon=True)

    def __call__(self) -> float:
        """Seconds awake since it was made."""
        return self._passed_s(self._clock())

    def look(self) -> None:
        """See that this program is awake."""
        now = self._clock()
        self._looked = now, self._passed_s(now)

    def _passed_s(self, now: float) -> float:
        looked_at, passed_s = self._looked
        return passed_s + min(now - looked_at, LOOK_COUNTS_S)

    def begin(self) -> None:
        """Look from here on, in a thread."""
        self._thread.start()

    def close(self) -> None:
        """Look no more."""
        self._closing.set()
        self._thread.join(JOIN_S)

    def _work(self) -> None:
        while not self._closing.wait(LOOK_S):
            self.look()
