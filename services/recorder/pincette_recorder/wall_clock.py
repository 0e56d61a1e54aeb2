"""UTC for a record, which does not step while one is open; steps of the machine's clock are noted.

Somebody may set the clock of the machine, or a time server may. Within a record time goes on from
where it began, by the monotonic clock, so that no sample lies before the one before it.
"""

from collections.abc import Callable
from time import monotonic_ns, time_ns

STEP_S = 0.5
"""A wall clock that has moved by so much more or less than time has passed was set."""
MOST = 5
"""Steps that are told one by one."""


class WallClock:
    """The time of day, anchored where a record begins."""

    def __init__(
        self,
        wall_ns: Callable[[], int] = time_ns,
        steady_ns: Callable[[], int] = monotonic_ns,
    ) -> None:
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        self._steps: list[tuple[float, float]] = []
        self._begun_ns = self._offset_ns = self._seen_ns = 0
        self.begin()

    def begin(self) -> None:
        """Take the time of day as it is, and forget the steps of before."""
        self._begun_ns = self._steady_ns()
        self._offset_ns = self._seen_ns = self._wall_ns() - self._begun_ns
        self._steps.clear()

    def now_ns(self) -> int:
        """Time in ns of UTC."""
        return self._offset_ns + self._steady_ns()

    def look(self) -> None:
        """Notice whether the machine's clock has been set since the last look."""
        steady_ns = self._steady_ns()
        offset_ns = self._wall_ns() - steady_ns
        step_s = 1e-9 * (offset_ns - self._seen_ns)
        if abs(step_s) >= STEP_S:
            self._steps.append((1e-9 * (steady_ns - self._begun_ns), step_s))
            self._seen_ns = offset_ns

    def words(self) -> str:
        """What was noticed since the begin; empty where nothing was."""
        told = [
            f"the wall clock was set by {step_s:+.1f} s, {at_s:.1f} s after the begin"
            for at_s, step_s in self._steps[:MOST]
        ]
        more = len(self._steps) - len(told)
        return "; ".join([*told, f"and {more} times more"] if more > 0 else told)
