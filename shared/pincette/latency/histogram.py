"""Histograms of durations over logarithmic buckets: bounded relative error, constant memory; pure.

Durations are counted in whole ns. Bucket b begins at

    n(b) = b                               for b < 64
    n(b) = (32 + b mod 32) · 2^(⌊b/32⌋-1)  else

so that each power of two is divided into 32 buckets of equal width. A bucket is reported as its
end, so that a quantile is never too short, and at most 1/32 of it, or 1 ns, too long. This is the
division of HdrHistogram (G. Tene) with five significant bits.
"""

from math import ceil

from pincette.control.quantities import Items, Second, Whole
from pincette.control.record import FrozenRecord

BITS = 5
STEPS = 1 << BITS
"""Number of buckets for a power of two."""
LINEAR = 2 * STEPS
"""Duration in ns below which each bucket covers 1 ns."""
LONGEST_BITS = 63
"""Number of bits of the longest duration in ns: 292 years."""
BUCKETS = (LONGEST_BITS - BITS - 1) * STEPS + LINEAR
NS_PER_S = 1e9


def bucket_of(duration_ns: int) -> int:
    """Return the bucket of a duration in ns; a negative one counts as zero."""
    if duration_ns < LINEAR:
        return max(0, duration_ns)
    shift = duration_ns.bit_length() - BITS - 1
    return shift * STEPS + (duration_ns >> shift)


def first_ns(bucket: int) -> int:
    """Return n(b), the shortest duration of a bucket in ns."""
    if bucket < LINEAR:
        return bucket
    shift = bucket // STEPS - 1
    return (STEPS + bucket % STEPS) << shift


class Distribution(FrozenRecord, frozen=True):
    """Counted durations as they are sent: the buckets that hold any, in order."""

    buckets: Items[Whole] = ()
    """Indices of the buckets in use; bucket b begins at b ns below 64, else at (32 + b mod 32) ·
    2^(b div 32 - 1) ns."""
    counts: Items[Whole] = ()
    """Number of durations in each of these buckets."""
    max_s: Second = 0.0
    """Longest duration, without rounding."""

    def __post_init__(self) -> None:
        buckets, counts = self.buckets, self.counts
        if len(buckets) != len(counts):
            raise ValueError(f"{len(buckets)} buckets with {len(counts)} counts")
        before = -1
        for bucket in buckets:
            if not before < bucket < BUCKETS:
                raise ValueError(f"bucket {bucket} after {before}: not in order up to {BUCKETS}")
            before = bucket
        if any(count <= 0 for count in counts):
            raise ValueError("a listed bucket is empty")

    @property
    def count(self) -> int:
        """Return the number of durations."""
        total = 0
        for count in self.counts:
            total += count
        return total

    def quantile_s(self, share: float) -> float | None:
        """Return the quantile of the durations for a fraction, in s.

        None if there are no durations.

        It is the end n(b+1) of the first bucket up to which at least ⌈share · count⌉ durations were
        counted, or the longest duration if that is less. It exceeds the true order statistic by at
        most 1/32 or 1 ns, and is never below it.
        """
        if not 0.0 <= share <= 1.0:
            raise ValueError(f"share = {share}: not within 0 to 1")
        rank, reached = max(1, ceil(share * self.count)), 0
        for bucket, count in zip(self.buckets, self.counts, strict=True):
            reached += count
            if reached >= rank:
                return min(self.max_s, first_ns(bucket + 1) / NS_PER_S)
        return None


class Histogram:
    """Counts durations without allocating memory."""

    __slots__ = ("_counts", "_max_s")

    def __init__(self) -> None:
        self._counts = [0] * BUCKETS
        self._max_s = 0.0

    def add(self, duration_s: float) -> None:
        """Count a duration in s.

        It repeats the code of ``bucket_of``, since calling that would double the time.
        """
        if duration_s > self._max_s:
            self._max_s = duration_s
        duration_ns = int(duration_s * NS_PER_S)
        if duration_ns < LINEAR:
            self._counts[max(0, duration_ns)] += 1
        else:
            shift = duration_ns.bit_length() - BITS - 1
            self._counts[shift * STEPS + (duration_ns >> shift)] += 1

    def clear(self) -> None:
        """Clear all counts."""
        self._counts = [0] * BUCKETS
        self._max_s = 0.0

    def distribution(self) -> Distribution:
        """Return the durations counted so far."""
        counts = self._counts
        longest = bucket_of(int(self._max_s * NS_PER_S))
        buckets = [bucket for bucket in range(longest + 1) if counts[bucket]]
        return Distribution(
            tuple(buckets), tuple([counts[bucket] for bucket in buckets]), self._max_s
        )
