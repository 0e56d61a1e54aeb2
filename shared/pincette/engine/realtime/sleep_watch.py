"""Detection of a suspended machine, by a clock that counts sleep and one that does not.

CLOCK_BOOTTIME advances while the machine sleeps; CLOCK_MONOTONIC stops, and with it every age. In a
paused virtual machine both stop. If its clock is corrected afterwards, the actuator cannot
distinguish the jump from a stall of its own program, which it excludes from ages only in part.
"""

from collections.abc import Callable
from time import CLOCK_BOOTTIME, CLOCK_MONOTONIC, clock_gettime

LEAST_S = 0.01
"""Shortest sleep that is reported, in s; a machine cannot sleep and wake up in less time."""
APART_S = 0.002
"""Longest time in which all three clock readings must be made, in s; otherwise they are not
compared."""

Clocks = Callable[[int], float]


class SleepWatch:
    """Compares the clocks at each call."""

    def __init__(self, clock: Clocks = clock_gettime) -> None:
        self._clock = clock
        self._ahead_s: float | None = None
        """Last difference between the clock that counts sleep and the one that does not, in s."""

    def slept_s(self) -> float:
        """Return the time that the machine slept since the last call, in s; 0.0 if it did not."""
        before_s = self._clock(CLOCK_MONOTONIC)
        with_sleep_s = self._clock(CLOCK_BOOTTIME)
        if self._clock(CLOCK_MONOTONIC) - before_s > APART_S:
            return 0.0  # preempted between the readings; the next call compares them
        ahead_s, known_s = with_sleep_s - before_s, self._ahead_s
        if known_s is None:
            self._ahead_s = ahead_s
            return 0.0
        slept_s = ahead_s - known_s
        if slept_s < LEAST_S:
            return 0.0
        self._ahead_s = ahead_s
        return slept_s
