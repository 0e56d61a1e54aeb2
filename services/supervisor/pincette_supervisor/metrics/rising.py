"""Counts that never fall, of tellers that begin anew whenever they are started or armed; pure."""

from bisect import bisect_left
from collections.abc import Hashable, Sequence

from pincette.latency.histogram import Distribution, first_ns

# fmt: off
BOUNDS_S = (
    1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0,
)
# fmt: on
"""Bounds of durations: 1, 2 and 5 of each decade."""
BOUNDS_NS = tuple(round(1e9 * bound_s) for bound_s in BOUNDS_S)
NS_PER_S = 1e9


class Rising:
    """A count that goes on where its teller begins at zero again."""

    __slots__ = ("_before", "_newest", "_start")

    def __init__(self) -> None:
        self._start: Hashable = None
        self._before = self._newest = 0

    def told(self, count: int, start: Hashable = None) -> None:
        """Take what is told; one of another start, or one that has fallen, has begun anew."""
        if start != self._start or count < self._newest:
            self._before += self._newest
        self._start, self._newest = start, count

    @property
    def total(self) -> int:
        """All that was ever told."""
        return self._before + self._newest


class RisingDurations:
    """A histogram that goes on where its teller begins an empty one."""

    __slots__ = ("_before", "_before_s", "_newest", "_start")

    def __init__(self) -> None:
        self._start: Hashable = None
        self._before = [0] * (len(BOUNDS_NS) + 1)
        self._before_s = 0.0
        self._newest = Distribution()

    def told(self, counted: Distribution, start: Hashable = None) -> None:
        """Take what is told; one of another start, or one that lacks something, has begun anew."""
        if start != self._start or not _grown(self._newest, counted):
            self._before = self.counts()
            self._before_s = self.sum_s
        self._start, self._newest = start, counted

    def counts(self) -> list[int]:
        """How many are within each bound and beyond the one before, and how many beyond all."""
        counts = [*self._before]
        for bucket, count in zip(self._newest.buckets, self._newest.counts, strict=True):
            counts[place_of(bucket)] += count
        return counts

    @property
    def sum_s(self) -> float:
        """Of all durations, each at the middle of its bucket: at most 1/64 off."""
        told = zip(self._newest.buckets, self._newest.counts, strict=True)
        return self._before_s + sum(_middle_s(bucket) * count for bucket, count in told)


def place_of(bucket: int) -> int:
    """The bound that a bucket counts towards: none of its durations is beyond it.

    So a duration never counts as shorter than it was, and at most 1/32 of it as longer.
    """
    return bisect_left(BOUNDS_NS, first_ns(bucket + 1) - 1)


def summed(counts: Sequence[int]) -> list[int]:
    """Counts with all before them, as Prometheus has its buckets."""
    total, found = 0, list[int]()
    for count in counts:
        total += count
        found.append(total)
    return found


def _grown(before: Distribution, after: Distribution) -> bool:
    """Whether a histogram has all that another one had."""
    having = dict(zip(after.buckets, after.counts, strict=True))
    return all(
        having.get(bucket, 0) >= count
        for bucket, count in zip(before.buckets, before.counts, strict=True)
    )


def _middle_s(bucket: int) -> float:
    return (first_ns(bucket) + first_ns(bucket + 1) - 1) / 2.0 / NS_PER_S
