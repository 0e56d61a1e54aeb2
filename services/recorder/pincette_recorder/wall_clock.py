"""UTC that does not step while a record is open; steps of the machine's clock are recorded."""

from collections.abc import Callable
from time import monotonic_ns, time_ns

STEP_S = 0.5
"""Smallest deviation in s between wall clock and elapsed time that counts as a step."""
MOST = 5
"""Largest number of steps that are listed individually."""


class WallClock:
    """Time of day, anchored at the beginning of a record."""

    def __init__(
        self,
        wall_ns: Callable[[], int] = time_ns,
        steady_ns: Callable[[], int] = monotonic_ns,
    ) -> None:
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        self._steps: list[tuple[float, float]] = []
        """Time in s since the beginning, and size in s, of each of the first steps."""
        self._more = 0
        """Number of steps beyond ``MOST``."""
        self._begun_ns = self._offset_ns = self._seen_ns = 0
        self.begin()

    def begin(self) -> None:
        """Anchor the monotonic clock at the time of day, and discard earlier steps."""
        self._begun_ns = self._steady_ns()
        self._offset_ns = self._seen_ns = self._wall_ns() - self._begun_ns
        self._steps.clear()
        self._more = 0

    def now_ns(self) -> int:
        """Return the time in ns of UTC."""
        return self._offset_ns + self._steady_ns()

    def look(self) -> None:
        """Check whether the machine's clock has been set since the last call."""
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
        """Return the steps noticed since the beginning as text; empty without any."""
        listed = [
            f"the wall clock was set by {step_s:+.1f} s, {at_s:.1f} s after the start"
            for at_s, step_s in self._steps
        ]
        more = self._more
        return "; ".join([*listed, f"and {more} times more"] if more else listed)
