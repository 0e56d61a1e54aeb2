"""Threads of their own that note when the machine did not run them."""

import os
import sys
import threading
from dataclasses import dataclass, field
from time import monotonic, sleep

BEAT_S = 0.001
STALL_S = 0.005


@dataclass
class StallRecorder:
    """Stalls as (begin, length) in seconds of the monotonic clock.

    One thread is bound to each processor, since a virtual machine may lose one of them while the
    others run: what was running there stands still, and nothing else notices.
    """

    stalls: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])

    def __enter__(self) -> "StallRecorder":
        self._stop = threading.Event()
        processors = os.sched_getaffinity(0) if sys.platform == "linux" else {-1}
        self._threads = [
            threading.Thread(target=self._beat, args=(processor,)) for processor in processors
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _beat(self, processor: int) -> None:
        if sys.platform == "linux":  # where 0 is the thread that asks
            os.sched_setaffinity(0, {processor})
        last = monotonic()
        while not self._stop.is_set():
            sleep(BEAT_S)
            now = monotonic()
            if now - last - BEAT_S > STALL_S:
                self.stalls.append((last, now - last - BEAT_S))
            last = now

    def between(self, begin_s: float, end_s: float) -> float:
        """Seconds of an interval in which some processor stood still, each counted once."""
        stood_s, reached_s = 0.0, begin_s
        for stall_s, length_s in sorted(self.stalls):
            first_s, last_s = max(reached_s, stall_s), min(end_s, stall_s + length_s)
            if last_s > first_s:
                stood_s, reached_s = stood_s + last_s - first_s, last_s
        return stood_s
