"""Wake-ups on an absolute grid, by the wait that a service of the loop waits with."""

from collections.abc import Callable
from queue import Empty, SimpleQueue
from time import monotonic

from pincette.latency.histogram import Histogram
from pincette.latency.rule import Measured

SETTLED = 10
"""Wake-ups that are not counted: code and clock are first used in them."""


def wait(timeout_s: float) -> None:
    """Wait as a service does, for something that does not come."""
    nothing: SimpleQueue[None] = SimpleQueue()
    try:
        nothing.get(timeout=timeout_s)
    except Empty:
        return


def wake_ups(
    period_s: float,
    for_s: float,
    clock_s: Callable[[], float] = monotonic,
    wait_s: Callable[[float], None] = wait,
) -> Measured:
    """Wake up each ``period_s`` for a while, and count by how much that was too late.

    A point of the grid that is over before its wake-up came is missed, and not caught up.
    """
    lateness, missed = Histogram(), 0
    begin_s = clock_s()
    due_s, settled_s = begin_s + period_s, begin_s + (SETTLED + 0.5) * period_s
    end_s = begin_s + for_s
    while due_s < end_s:
        now = clock_s()
        while now < due_s:
            wait_s(due_s - now)
            now = clock_s()
        late_s = now - due_s
        skipped = int(late_s / period_s)
        if due_s > settled_s:
            lateness.add(late_s)
            missed += skipped
        due_s += (skipped + 1) * period_s
    return Measured(period_s, lateness.told(), missed)
