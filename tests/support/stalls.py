"""A thread of its own that notes when the machine did not run it."""

import threading
from dataclasses import dataclass, field
from time import monotonic, sleep

BEAT_S = 0.001
STALL_S = 0.005


@dataclass
class StallRecorder:
    """Stalls as (begin, length) in seconds of the monotonic clock."""

    stalls: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])

    def __enter__(self) -> "StallRecorder":
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._beat)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _beat(self) -> None:
        last = monotonic()
        while not self._stop.is_set():
            sleep(BEAT_S)
            now = monotonic()
            if now - last - BEAT_S > STALL_S:
                self.stalls.append((last, now - last - BEAT_S))
            last = now

    def between(self, begin_s: float, end_s: float) -> float:
        """Seconds of stalls within an interval."""
        total = 0.0
        for stall_s, length_s in list(self.stalls):
            overlap = min(end_s, stall_s + length_s) - max(begin_s, stall_s)
            total += max(0.0, overlap)
        return total
