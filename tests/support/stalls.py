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
BLAMED_S = 0.020
"""A stall of a period may make a rig at T = 20 ms trip."""
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


Test = Callable[P, None]


def again_after_a_stall(make_ready: Callable[[Any], None]) -> Callable[[Test[P]], Test[P]]:
    """Repeat a test of real time that failed while the machine stood still; other failures stand.

    For tests with the fixture ``stalls``; what they call ``rig`` is made ready again. A rig at
    T = 20 ms may trip by itself where a processor is away for more than a period, and what the
    test meant to see is then not there.
    """

    def decorate(test: Test[P]) -> Test[P]:
        @wraps(test)
        def repeated(*args: P.args, **kwargs: P.kwargs) -> None:
            recorder = cast(StallRecorder, kwargs["stalls"])
            for last in (False, False, True):
                begun = monotonic()
                try:
                    return test(*args, **kwargs)
                except (AssertionError, TimeoutError):
                    stood = [length_s for at, length_s in recorder.stalls if at >= begun - 0.1]
                    if last or max(stood, default=0.0) < BLAMED_S:
                        raise
                    print(f"again: the machine stood still for {1e3 * max(stood):.0f} ms")
                    make_ready(kwargs.get("rig"))
            return None

        return repeated

    return decorate
