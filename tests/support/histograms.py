"""Distributions of durations, made and merged in one call."""

from collections.abc import Iterable

from pincette.latency.histogram import Distribution, Histogram


def merged(parts: Iterable[Distribution]) -> Distribution:
    """Merge the counts of several distributions, exactly as if one had counted everything."""
    together: dict[int, int] = {}
    max_s = 0.0
    for part in parts:
        max_s = max(max_s, part.max_s)
        for bucket, count in zip(part.buckets, part.counts, strict=True):
            together[bucket] = together.get(bucket, 0) + count
    buckets = tuple(sorted(together))
    return Distribution(buckets, tuple(together[bucket] for bucket in buckets), max_s)


def counted(durations_s: Iterable[float]) -> Distribution:
    """Return a distribution of durations in s."""
    histogram = Histogram()
    for duration_s in durations_s:
        histogram.add(duration_s)
    return histogram.distribution()
