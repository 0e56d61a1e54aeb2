"""Counts of errors on the lines of one program's instruments."""

from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from pincette.instruments.line.arrivals import Arrivals


@dataclass(slots=True)
class LineCounts:
    """Totals since the program started, over all lines that it opened."""

    late: int = 0
    """Number of answers that arrived after the timeout of their request."""
    lost: int = 0
    """Number of answers that never arrived."""
    unexpected: int = 0
    """Number of answers without a request, such as repeated ones."""
    reopened: int = 0
    """Number of times that a lost or silent port was reopened."""
    retried: int = 0
    """Number of times that opening an instrument failed and was repeated."""
    arrivals: dict[str, Arrivals] = field(default_factory=dict[str, Arrivals])
    """Durations of exchanges, by the url of each open TCP connection."""


_COUNTS: ContextVar[LineCounts | None] = ContextVar("counts", default=None)


@contextmanager
def counting(counts: LineCounts) -> Generator[None]:
    """Count the events of every line opened within the block, as long as the line is open."""
    token = _COUNTS.set(counts)
    try:
        yield
    finally:
        _COUNTS.reset(token)


def current_counts() -> LineCounts:
    """Return the counts of the enclosing ``counting`` block, or new ones outside such a block."""
    return _COUNTS.get() or LineCounts()
