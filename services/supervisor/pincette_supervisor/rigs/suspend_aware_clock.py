"""A clock that does not count time for which this process was suspended."""

from collections.abc import Callable
from time import monotonic

from pincette.engine.threads import RepeatedAction

SAMPLE_S = 0.05
SAMPLE_COUNTS_S = 0.1
"""The most that one sample counts for."""
JOIN_S = 2.0


class SuspendAwareClock:
    """A clock that stands still while its process is suspended."""

    # A process that was stopped, or not scheduled, receives all pending messages when it resumes.
    # By this clock none of their senders was silent meanwhile.

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._sampled = clock(), 0.0
        """Time of the last sample and the time counted by then; one value, read by any thread."""
        self._repeated = RepeatedAction("suspend-aware-clock", SAMPLE_S, self.sample)

    def __call__(self) -> float:
        """Seconds awake since creation."""
        return self._passed_s(self._clock())

    def sample(self) -> None:
        """Count the time since the last sample."""
        now = self._clock()
        self._sampled = now, self._passed_s(now)

    def _passed_s(self, now: float) -> float:
        sampled_at, passed_s = self._sampled
        return passed_s + min(now - sampled_at, SAMPLE_COUNTS_S)

    def start(self) -> None:
        """Start sampling in a thread."""
        self._repeated.start()

    def close(self) -> None:
        """Stop the thread."""
        self._repeated.close(JOIN_S)
