"""Processor time of the supervisor, and what it did while it received nothing.

A thread wakes on a time grid and measures its lateness: during that time no code of this process
ran, since the processor or the interpreter's lock was in use. It also records the activities of the
process: messages of the bus, writes of the journal, drawing. Their times overlap, since threads do.
"""

import threading
from collections import deque
from collections.abc import Callable, Generator
from contextlib import contextmanager
from time import monotonic
from typing import Literal

from pincette.engine.threads import RepeatedAction

Share = Literal["bus", "journal", "drawing"]
GRID_S = 0.05
LATE_S = 0.02
"""Largest lateness of the thread that still counts as in time, in s."""
KEPT = 1200
"""Number of rows of the grid in memory: one minute."""
WORDS: dict[Share, str] = {
    "bus": "messages of the bus",
    "journal": "the journal",
    "drawing": "drawing",
}


class ProcessLoad:
    """Counters and the last minute of their values; safe to use from several threads."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._spent_s: dict[Share, float] = dict.fromkeys(WORDS, 0.0)
        self._late_s = 0.0
        self._sampled_s = clock()
        self._rows: deque[tuple[float, float, dict[Share, float]]] = deque(maxlen=KEPT)
        self._beside: tuple[Callable[[], None], ...] = ()
        self._repeated = RepeatedAction("process_load", GRID_S, self._look)

    @contextmanager
    def at(self, share: Share) -> Generator[None]:
        """Count the time spent within the ``with`` block."""
        begun_s = self._clock()
        try:
            yield
        finally:
            self.add(share, self._clock() - begun_s)

    def add(self, share: Share, duration_s: float) -> None:
        """Add time spent on an activity, in s."""
        with self._lock:
            self._spent_s[share] += duration_s

    def sample(self) -> None:
        """Record the lateness of the grid's thread."""
        now_s = self._clock()
        with self._lock:
            late_s = now_s - self._sampled_s - GRID_S
            self._sampled_s = now_s
            self._late_s += late_s if late_s > LATE_S else 0.0
            self._rows.append((now_s, self._late_s, dict(self._spent_s)))

    def _look(self) -> None:
        self.sample()
        for one in self._beside:
            one()

    def within(self, last_s: float) -> tuple[float, dict[Share, float]]:
        """Return the time in which no code ran, and the time by activity, within the last
        ``last_s``.
        """
        self.sample()
        since_s = self._clock() - last_s
        with self._lock:
            rows = list(self._rows)
        begun = next((row for row in reversed(rows) if row[0] <= since_s), rows[0])
        spent_s: dict[Share, float] = {
            share: total - begun[2][share] for share, total in rows[-1][2].items()
        }
        return rows[-1][1] - begun[1], spent_s

    def totals(self) -> tuple[float, dict[Share, float]]:
        """Return the time in which no code ran, and the time by activity, since the start, in s."""
        with self._lock:
            return self._late_s, dict(self._spent_s)

    def start(self, *beside: Callable[[], None]) -> None:
        """Start measuring in a thread that also calls ``beside`` each time."""
        self._beside = beside
        self._repeated.start()

    def close(self) -> None:
        """Stop measuring."""
        self._repeated.close(2.0)


PROCESS_LOAD = ProcessLoad()
"""Load of this process; there is one for each process, as for processor time."""


def share_words(last_s: float, process_load: ProcessLoad = PROCESS_LOAD) -> str:
    """Describe how the last seconds were spent, in words."""
    stood_s, spent_s = process_load.within(last_s)
    shares = ", ".join(f"{WORDS[share]} {value:.2f} s" for share, value in spent_s.items())
    return f"in the last {last_s:.1f} s this program was stalled for {stood_s:.2f} s; {shares}"
