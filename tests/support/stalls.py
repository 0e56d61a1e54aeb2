"""Separate threads that record when the machine did not run them."""

import os
import sys
import threading
from dataclasses import dataclass, field
from itertools import islice, takewhile
from math import inf
from pathlib import Path
from time import monotonic, sleep

from pincette.engine.realtime.os_scheduling import raise_priority

BEAT_S = 0.001
STALL_S = 0.005
SHORT_S = 0.001
"""Shortest stall that counts if no other thread of the machine had the processor, in s; only on a
virtual machine that is not run in short slices."""
SPAN_S, BLAMED_S = 0.100, 0.005
"""Interval in which a rig at T = 20 ms can trip, and the total length of stalls within it that may
spoil a test, in s; the loop does not wait longer for an instrument that owes a reply."""
TICK_S = 0.01
"""Unit in which the system counts processor time in /proc, in s."""


Span = tuple[float, float]
"""Begin and end, in seconds of the monotonic clock."""


@dataclass
class StallRecorder:
    """Stalls as (begin, length) in seconds of the monotonic clock.

    ``stalls`` are times in which the machine did not run one of its processors at all, ``waits``
    times in which other processes used it. One thread is bound to each processor, since a virtual
    machine may lose one processor while the others run, which stops only the programs on that
    processor. The threads have the priority of the loop.
    """

    stalls: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    waits: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])

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
        if sys.platform == "linux":  # here 0 is the calling thread
            os.sched_setaffinity(0, {processor})
        raise_priority()
        stolen_s = stolen(processor)
        with _Queue() as queue:
            last, queued_s = monotonic(), queue.waited_s()
            while not self._stop.is_set():
                sleep(BEAT_S)
                now, before_s, queued_s = monotonic(), queued_s, queue.waited_s()
                late_s = now - last - BEAT_S
                waited_s = min(late_s, queued_s - before_s)
                away_s = late_s - waited_s
                if late_s > STALL_S:
                    # A processor that is taken away while this thread waits counts as waiting, too.
                    before_s, stolen_s = stolen_s, stolen(processor)
                    away_s = max(away_s, min(late_s, stolen_s - before_s))
                if away_s > SHORT_S:
                    self.stalls.append((last, away_s))
                if late_s - away_s > STALL_S:
                    self.waits.append((last, late_s - away_s))
                last = now

    def blamed_s(self, begin_s: float, end_s: float, elsewhere_s: float = 0.0) -> float:
        """Return the largest time within any ``SPAN_S`` of a window that the product cannot be
        blamed for, in s.

        Waits count if programs other than the test's had the processors for that time:
        ``elsewhere_s`` within the window.
        """
        stood_s = self.most(begin_s, end_s)
        both = StallRecorder(self.stalls + self.waits).most(begin_s, end_s)
        return max(stood_s, min(both, elsewhere_s))

    def most(self, begin_s: float, end_s: float = inf) -> float:
        """Return the largest time within any ``SPAN_S`` of a window for which some processor was
        stalled, in s."""
        apart = [
            (max(first_s, begin_s), min(last_s, end_s))
            for first_s, last_s in self.apart()
            if first_s < end_s and last_s > begin_s
        ]
        most_s = 0.0
        for place, (first_s, _) in enumerate(apart):
            until_s = first_s + SPAN_S
            within = takewhile(
                lambda stall, until_s=until_s: stall[0] < until_s, islice(apart, place, None)
            )
            most_s = max(most_s, sum(min(last_s, until_s) - begun_s for begun_s, last_s in within))
        return most_s

    def between(self, begin_s: float, end_s: float, least_s: float = 0.0) -> float:
        """Return the time of an interval in which some processor was stalled, each moment counted
        once, in s.

        Stalls below ``least_s`` are left out: they make a ramp longer, and lose no tick.
        """
        apart = self.apart(least_s)
        parts = (min(end_s, last_s) - max(begin_s, first_s) for first_s, last_s in apart)
        return sum(part_s for part_s in parts if part_s > 0.0)

    def apart(self, least_s: float = 0.0) -> list[Span]:
        """Return the intervals in which some processor was stalled, without overlap and sorted."""
        apart: list[Span] = []
        for begin_s, length_s in sorted(self.stalls):
            first_s = max(begin_s, apart[-1][1]) if apart else begin_s
            if length_s >= least_s and begin_s + length_s > first_s:
                apart.append((first_s, begin_s + length_s))
        return apart


def stolen(processor: int) -> float:
    """Return the time since the start of the system for which a processor was taken away from
    it, in s."""
    try:
        lines = Path("/proc/stat").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0.0
    words = next(
        (line.split() for line in lines if line.startswith(f"cpu{processor} ")), list[str]()
    )
    return TICK_S * int(words[8]) if len(words) > 8 else 0.0


@dataclass(frozen=True, slots=True)
class Usage:
    """Processor time since the start of the system."""

    all_s: float
    own_s: float
    """CPU time of this process, its descendants, and those of them that have ended, in s."""

    def elsewhere_s(self, before: "Usage") -> float:
        """Return the CPU time used by programs other than the test's since then, in s."""
        return max(0.0, (self.all_s - before.all_s) - (self.own_s - before.own_s))


def usage() -> Usage:
    """Return the processor time until now; None if the system does not report it."""
    try:
        words = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()
    except OSError:
        return Usage(0.0, 0.0)
    user, nice, system, _idle, _waiting, irq, softirq = map(int, words[1:8])
    parents: dict[int, int] = {}
    used: dict[int, int] = {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            fields = (place / "stat").read_text(errors="replace").rpartition(")")[2].split()
        except OSError:  # the process has ended meanwhile
            continue
        parents[int(place.name)] = int(fields[1])
        used[int(place.name)] = sum(map(int, fields[11:15]))
    own = {os.getpid()}
    while grown := {process for process, parent in parents.items() if parent in own} - own:
        own |= grown
    own_ticks = sum(used.get(process, 0) for process in own)
    return Usage(TICK_S * (user + nice + system + irq + softirq), TICK_S * own_ticks)


class _Queue:
    """Time for which the creating thread has waited for a processor that another thread had."""

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
        """Return the waiting time since the start, in s; without a counter, infinity."""
        if self._file is None:
            return monotonic()
        return 1e-9 * int(os.pread(self._file, 100, 0).split()[1])
