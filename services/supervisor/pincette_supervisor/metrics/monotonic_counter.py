"""Counters and histograms that never fall, of sources that restart at zero; pure."""

from bisect import bisect_left
from collections.abc import Hashable

from pincette.latency.histogram import Distribution, first_ns

# fmt: off
BOUNDS_S = (
    1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0,
)
# fmt: on
"""Bounds of durations: 1, 2 and 5 of each decade."""
BOUNDS_NS = tuple(round(1e9 * bound_s) for bound_s in BOUNDS_S)
NS_PER_S = 1e9


class MonotonicCounter:
    """A count that goes on when its source restarts at zero."""

    __slots__ = ("_before", "_newest", "_start")

    def __init__(self) -> None:
        self._start: Hashable = None
        self._before = self._newest = 0

    def update(self, count: int, start: Hashable = None) -> None:
        """Take the source's count; another ``start``, or a smaller count, means a restart."""
        if start != self._start or count < self._newest:
            self._before += self._newest
        self._start, self._newest = start, count

    @property
    def total(self) -> int:
        """The total over all restarts."""
        return self._before + self._newest


class MonotonicHistogram:
    """A histogram that goes on when its source restarts empty."""

    __slots__ = ("_before", "_before_s", "_newest", "_start")

    def __init__(self) -> None:
        self._start: Hashable = None
        self._before = [0] * (len(BOUNDS_NS) + 1)
        self._before_s = 0.0
        self._newest = Distribution()

    def update(self, counted: Distribution, start: Hashable = None) -> None:
        """Take the source's histogram; another ``start``, or a smaller count, means a restart."""
        if start != self._start or not _grown(self._newest, counted):
            self._before = self.counts()
            self._before_s = self.sum_s
        self._start, self._newest = start, counted

    def counts(self) -> list[int]:
        """Counts between each bound and the one before, and beyond the last."""
        counts = [*self._before]
        for bucket, count in zip(self._newest.buckets, self._newest.counts, strict=True):
            counts[bound_index(bucket)] += count
        return counts

    @property
    def sum_s(self) -> float:
        """Sum of all durations, each at the middle of its bucket: at most 1/64 off."""
        counted = zip(self._newest.buckets, self._newest.counts, strict=True)
        return self._before_s + sum(_middle_s(bucket) * count for bucket, count in counted)


def bound_index(bucket: int) -> int:
    """Index of the smallest bound that no duration of the bucket exceeds; at most 1/32 above."""
    return bisect_left(BOUNDS_NS, first_ns(bucket + 1) - 1)


def _grown(before: Distribution, after: Distribution) -> bool:
    """Whether no bucket has fewer counts than before."""
    having = dict(zip(after.buckets, after.counts, strict=True))
    return all(
        having.get(bucket, 0) >= count
        for bucket, count in zip(before.buckets, before.counts, strict=True)
    )


def _middle_s(bucket: int) -> float:
    return (first_ns(bucket) + first_ns(bucket + 1) - 1) / 2.0 / NS_PER_S
