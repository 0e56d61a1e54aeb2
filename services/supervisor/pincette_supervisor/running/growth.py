"""Counters that should not grow, or only slowly: what they grow by within a while; pure."""

from dataclasses import dataclass, field


@dataclass(slots=True)
class Growth:
    """A counter of a program, seen from time to time; a smaller value begins it anew."""

    limit: int
    """Growth within ``window_s`` from which on it is told."""
    window_s: float
    _last: int | None = None
    _since_s: float = 0.0
    _grown: int = field(default=0)

    def follow(self, value: int, now_s: float) -> int:
        """Take a value; returns by how much it has grown, once that is worth telling."""
        last, self._last = self._last, value
        if last is None or value < last:
            self._since_s, self._grown = now_s, 0
            return 0
        if now_s - self._since_s > self.window_s:
            self._since_s, self._grown = now_s, 0
        self._grown += value - last
        if self._grown < self.limit:
            return 0
        grown, self._grown, self._since_s = self._grown, 0, now_s
        return grown
