"""UTC that does not step while a record is open; steps of the machine's clock are noted."""

from collections.abc import Callable
from time import monotonic_ns, time_ns

STEP_S = 0.5
"""A wall clock that has moved by so much more or less than time has passed was set."""
MOST = 5
"""Steps that are listed one by one."""


class WallClock:
    """The time of day, anchored where a record begins."""

    def __init__(
        self,
        wall_ns: Callable[[], int] = time_ns,
        steady_ns: Callable[[], int] = monotonic_ns,
    ) -> None:
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        self._steps: list[tuple[float, float]] = []
        """Time since the begin and size of each of the first steps."""
        self._more = 0
        """Steps beyond those."""
        self._begun_ns = self._offset_ns = self._seen_ns = 0
        self.begin()

    def begin(self) -> None:
        """Anchor the monotonic clock at the time of day, and forget earlier steps."""
        self._begun_ns = self._steady_ns()
        self._offset_ns = self._seen_ns = self._wall_ns() - self._begun_ns
        self._steps.clear()
        self._more = 0

    def now_ns(self) -> int:
        """Return the time in ns of UTC."""
        return self._offset_ns + self._steady_ns()

    def look(self) -> None:
        """Notice whether the machine's clock has been set since the last look."""
        steady_ns = self._steady_ns()
        offset_ns = self._wall_ns() - steady_ns
        step_s = 1e-9 * (offset_ns - self._seen_ns)
        if abs(step_s) >= STEP_S:
            if len(self._steps) < MOST:
                self._steps.append((1e-9 * (steady_ns - self._begun_ns), step_s))
            else:
                self._more += 1
            self._seen_ns = offset_ns

    def words(self) -> str:
        """Return what was noticed since the begin; empty where nothing was."""
        listed = [
            f"the wall clock was set by {step_s:+.1f} s, {at_s:.1f} s after the begin"
            for at_s, step_s in self._steps
        ]
        more = self._more
        return "; ".join([*listed, f"and {more} times more"] if more else listed)
