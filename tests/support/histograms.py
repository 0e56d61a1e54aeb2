"""Distributions of durations, made and merged at once."""

from collections.abc import Iterable

from pincette.latency.histogram import Distribution, Histogram


def merged(parts: Iterable[Distribution]) -> Distribution:
    """All that several have counted, exactly as if one had counted it."""
    together: dict[int, int] = {}
    max_s = 0.0
    for part in parts:
        max_s = max(max_s, part.max_s)
        for bucket, count in zip(part.buckets, part.counts, strict=True):
            together[bucket] = together.get(bucket, 0) + count
    buckets = tuple(sorted(together))
    return Distribution(buckets, tuple(together[bucket] for bucket in buckets), max_s)


def counted(durations_s: Iterable[float]) -> Distribution:
    """Durations in s, counted."""
    histogram = Histogram()
    for duration_s in durations_s:
        histogram.add(duration_s)
    return histogram.distribution()
