"""Threads of their own that note when the machine did not run them."""

import os
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from time import monotonic, sleep
from typing import Any, ParamSpec, cast

from pincette.runtime.priority import come_first

BEAT_S = 0.001
STALL_S = 0.005
SHORT_S = 0.001
"""Of a virtual machine that is not run in short slices, each of which counts where no other
thread of it had the processor."""
SPAN_S, BLAMED_S = 0.100, 0.020
"""Stalls of a period in all, within so long, may make a rig at T = 20 ms trip."""
TRIES = 5
P = ParamSpec("P")


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
        begins = [at for at, _ in self.stalls if at >= since_s]
        return max((self.between(at, at + SPAN_S) for at in begins), default=0.0)

    def between(self, begin_s: float, end_s: float, least_s: float = 0.0) -> float:
        """Seconds of an interval in which some processor stood still, each counted once.

        Stalls below ``least_s`` are left out: they make a ramp longer, and lose no tick.
        """
        stood_s, reached_s = 0.0, begin_s
        for stall_s, length_s in sorted(self.stalls):
            if length_s < least_s:
                continue
            first_s, last_s = max(reached_s, stall_s), min(end_s, stall_s + length_s)
            if last_s > first_s:
                stood_s, reached_s = stood_s + last_s - first_s, last_s
        return stood_s


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


Test = Callable[P, None]


def again_after_a_stall(make_ready: Callable[[Any], None]) -> Callable[[Test[P]], Test[P]]:
    """Repeat a test of real time that failed while the machine stood still; other failures stand.

    For tests with the fixture ``stalls``; what they call ``rig`` is made ready again. A rig at
    T = 20 ms may trip by itself where a processor is away for a period, and what the test meant to
    see is then not there.
    """

    def decorate(test: Test[P]) -> Test[P]:
        @wraps(test)
        def repeated(*args: P.args, **kwargs: P.kwargs) -> None:
            recorder = cast(StallRecorder, kwargs["stalls"])
            for last in (*[False] * (TRIES - 1), True):
                begun = monotonic()
                try:
                    return test(*args, **kwargs)
                except (AssertionError, TimeoutError):
                    stood_s = recorder.most(begun - SPAN_S)
                    if last or stood_s < BLAMED_S:
                        raise
                    print(f"again: the machine stood still for {1e3 * stood_s:.0f} ms")
                    make_ready(kwargs.get("rig"))
            return None

        return repeated

    return decorate
