"""Threads of their own that note when the machine did not run them."""

import os
import sys
import threading
from dataclasses import dataclass, field
from itertools import islice, takewhile
from time import monotonic, sleep

from pincette.runtime.priority import come_first

BEAT_S = 0.001
STALL_S = 0.005
SHORT_S = 0.001
"""Of a virtual machine that is not run in short slices, each of which counts where no other
thread of it had the processor."""
SPAN_S, BLAMED_S = 0.100, 0.005
"""Stalls of so long in all, within the length that lets a rig at T = 20 ms trip, may spoil a test:
more than that an instrument that owes an answer is not waited for."""
TRIES = 5
"""How often a test of real time is made at most, where stalls may have spoilt it."""


@dataclass
class StallRecorder:
    """Stalls as (begin, length) in seconds of the monotonic clock.

    One thread is bound to each processor, since a virtual machine may lose one of them while the
    others run: what was running there stands still, and nothing else notices. They run as early
    as the loop does, so that what does not delay the loop counts as no stall.
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
        come_first()
        with _Queue() as queue:
            last, queued_s = monotonic(), queue.waited_s()
            while not self._stop.is_set():
                sleep(BEAT_S)
                now, before_s, queued_s = monotonic(), queued_s, queue.waited_s()
                late_s = now - last - BEAT_S
                away_s = late_s if late_s > STALL_S else late_s - (queued_s - before_s)
                if away_s > SHORT_S:
                    self.stalls.append((last, away_s))
                last = now

    def most(self, since_s: float) -> float:
        """Seconds for which some processor stood still, at most in ``SPAN_S`` since then."""
        apart = [(first_s, last_s) for first_s, last_s in self.apart() if first_s >= since_s]
        most_s = 0.0
        for place, (begin_s, _) in enumerate(apart):
            end_s = begin_s + SPAN_S
            within = takewhile(
                lambda stall, end_s=end_s: stall[0] < end_s, islice(apart, place, None)
            )
            most_s = max(most_s, sum(min(last_s, end_s) - first_s for first_s, last_s in within))
        return most_s

    def between(self, begin_s: float, end_s: float, least_s: float = 0.0) -> float:
        """Seconds of an interval in which some processor stood still, each counted once.

        Stalls below ``least_s`` are left out: they make a ramp longer, and lose no tick.
        """
        apart = self.apart(least_s)
        parts = (min(end_s, last_s) - max(begin_s, first_s) for first_s, last_s in apart)
        return sum(part_s for part_s in parts if part_s > 0.0)

    def apart(self, least_s: float = 0.0) -> list[tuple[float, float]]:
        """From when to when some processor stood still, without overlap and in order."""
        apart: list[tuple[float, float]] = []
        for begin_s, length_s in sorted(self.stalls):
            first_s = max(begin_s, apart[-1][1]) if apart else begin_s
            if length_s >= least_s and begin_s + length_s > first_s:
                apart.append((first_s, begin_s + length_s))
        return apart


class _Queue:
    """How long the thread that made this has waited for a processor that another thread had."""

    def __enter__(self) -> "_Queue":
        try:
            self._file = os.open(f"/proc/self/task/{threading.get_native_id()}/schedstat", 0)
        except OSError:
            self._file = None
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            os.close(self._file)

    def waited_s(self) -> float:
        """Seconds since it began; where nobody counts, all the time that there is."""
        if self._file is None:
            return monotonic()
        return 1e-9 * int(os.pread(self._file, 100, 0).split()[1])
