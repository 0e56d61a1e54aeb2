"""Histograms: a quantile is never too short, and a bucket too long at most; merging is exact."""

from itertools import pairwise
from math import ceil

import pytest
from hypothesis import given
from hypothesis import strategies as some

from pincette.latency.histogram import (
    BUCKETS,
    LINEAR,
    NS_PER_S,
    Distribution,
    Histogram,
    bucket_of,
    first_ns,
)
from tests.support.histograms import counted, merged

RELATIVE_ERROR = 1.0 / 32.0
DURATIONS = some.floats(0.0, 1e6)
MANY = some.lists(DURATIONS, max_size=60)


def test_buckets_follow_each_other_without_a_gap() -> None:
    starts = [first_ns(bucket) for bucket in range(BUCKETS + 1)]
    assert starts[0] == 0
    assert all(later > sooner for sooner, later in pairwise(starts))
    assert starts[BUCKETS] == 2**63


@given(some.integers(0, 2**63 - 1))
def test_a_duration_is_within_its_bucket(duration_ns: int) -> None:
    bucket = bucket_of(duration_ns)
    assert first_ns(bucket) <= duration_ns < first_ns(bucket + 1)
    assert 0 <= bucket < BUCKETS


def test_a_bucket_is_no_wider_than_the_stated_relative_error() -> None:
    for bucket in range(BUCKETS):
        width_ns = first_ns(bucket + 1) - first_ns(bucket)
        assert width_ns == 1 or width_ns <= RELATIVE_ERROR * first_ns(bucket)
    assert first_ns(LINEAR + 1) - first_ns(LINEAR) == 2


def test_negative_durations_count_as_zero() -> None:
    assert bucket_of(-5) == 0
    assert counted([-1e-9, -1.0, 0.0]) == Distribution((0,), (3,), 0.0)


@given(some.lists(DURATIONS, min_size=1, max_size=60), some.floats(0.0, 1.0))
def test_a_quantile_is_the_order_statistic_or_a_bucket_above_it(
    durations_s: list[float], share: float
) -> None:
    told_s = counted(durations_s).quantile_s(share)
    assert told_s is not None
    place = max(1, ceil(share * len(durations_s))) - 1
    true_s = sorted(durations_s)[place]
    assert true_s <= told_s * (1.0 + 1e-12)
    assert told_s <= (true_s * (1.0 + RELATIVE_ERROR) + 1.0 / NS_PER_S) * (1.0 + 1e-12)


@given(some.lists(DURATIONS, min_size=1))
def test_the_longest_duration_is_exact(durations_s: list[float]) -> None:
    histogram = counted(durations_s)
    assert histogram.max_s == max(durations_s)
    assert histogram.quantile_s(1.0) == histogram.max_s
    assert histogram.count == len(durations_s)


@given(some.lists(MANY, max_size=4))
def test_merged_histograms_equal_a_single_histogram_of_all_values(parts: list[list[float]]) -> None:
    assert merged(map(counted, parts)) == counted([one for part in parts for one in part])


def test_an_empty_histogram_has_no_quantile() -> None:
    assert Histogram().distribution() == Distribution()
    assert Distribution().quantile_s(0.5) is None


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_quantile_outside_0_to_1_is_refused(share: float) -> None:
    with pytest.raises(ValueError, match="not within 0 to 1"):
        counted([1.0]).quantile_s(share)


def test_clearing_restarts_the_count() -> None:
    histogram = Histogram()
    histogram.add(1.0)
    histogram.clear()
    assert histogram.distribution() == Distribution()


@pytest.mark.parametrize(
    ("buckets", "counts", "why"),
    [
        ((1, 2), (1,), "2 buckets with 1 counts"),
        ((2, 1), (1, 1), "bucket 1 after 2"),
        ((1, 1), (1, 1), "bucket 1 after 1"),
        ((-1,), (1,), "bucket -1"),
        ((BUCKETS,), (1,), f"bucket {BUCKETS}"),
        ((1,), (0,), "is empty"),
    ],
)
def test_an_impossible_histogram_is_refused(
    buckets: tuple[int, ...], counts: tuple[int, ...], why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        Distribution(buckets, counts, 1.0)
