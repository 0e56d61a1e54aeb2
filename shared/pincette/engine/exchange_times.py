"""Durations of the newest exchanges with one instrument, as the program measures them."""

from collections import deque
from collections.abc import Sequence
from statistics import median

from msgspec.structs import replace

from pincette.core.messages.requests import ExchangeTimes
from pincette.instruments.line.arrivals import Arrivals

KEPT = 40
"""Number of the newest exchanges that are kept."""


class ExchangeRecorder:
    """Keeps the durations of the newest exchanges that succeeded."""

    def __init__(self) -> None:
        self._took_s: deque[float] = deque(maxlen=KEPT)

    def add(self, took_s: float) -> None:
        """Add the duration of an exchange, in s."""
        self._took_s.append(took_s)

    def times(self) -> ExchangeTimes | None:
        """Return statistics of the newest exchanges; None before the first one."""
        return times_of(self._took_s)


def times_of(took_s: Sequence[float]) -> ExchangeTimes | None:
    """Return the minimum, median and maximum of some durations; None without any."""
    if not took_s:
        return None
    return ExchangeTimes(len(took_s), min(took_s), median(took_s), max(took_s))


def with_hop(times: ExchangeTimes, arrivals: Arrivals | None) -> ExchangeTimes:
    """Return the durations together with the properties of a device server that the arrival of
    replies reveals.
    """
    if arrivals is None:
        return times
    hop = arrivals.hop()
    return replace(times, held_s=hop.held_s, line_baud=hop.line_baud)


def in_words(times: ExchangeTimes) -> str:
    """Return the durations as text, in ms."""
    values = (times.minimum_s, times.median_s, times.worst_s)
    shown = "/".join(f"{1e3 * value:.1f}" for value in values)
    return f"{shown} ms (minimum/median/worst of {times.count})"
