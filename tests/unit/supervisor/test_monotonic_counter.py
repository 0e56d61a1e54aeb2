"""Counters continue if their program restarts, and no duration counts as shorter than it was."""

from hypothesis import given
from hypothesis import strategies as st

from pincette.latency.histogram import BUCKETS, first_ns
from pincette_supervisor.rigs.counters import (
    BOUNDS_NS,
    BOUNDS_S,
    MonotonicCounter,
    MonotonicHistogram,
    bound_index,
)
from tests.support.histograms import counted

TOLD = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 50)), max_size=40)
DURATIONS_S = st.lists(st.floats(0.0, 3.0), max_size=30)


def test_a_count_continues_after_a_restart() -> None:
    count = MonotonicCounter()
    for reported, start in ((3, 1), (5, 1), (0, 2), (2, 2), (1, 2)):
        count.update(reported, start)
    assert count.total == 5 + 2 + 1


@given(TOLD)
def test_a_count_never_decreases_and_includes_the_newest(told: list[tuple[int, int]]) -> None:
    count, before = MonotonicCounter(), 0
    for start, value in told:
        count.update(value, start)
        assert count.total >= max(before, value)
        before = count.total


@given(st.lists(st.tuples(st.integers(0, 2), DURATIONS_S), max_size=8))
def test_no_bucket_ever_decreases(told: list[tuple[int, list[float]]]) -> None:
    durations = MonotonicHistogram()
    before, before_s = durations.counts(), 0.0
    for start, values in told:
        durations.update(counted(values), start)
        after = durations.counts()
        assert all(new >= old for new, old in zip(after, before, strict=True))
        assert sum(after) >= len(values)
        assert durations.sum_s >= before_s - 1e-12
        before, before_s = after, durations.sum_s


@given(DURATIONS_S, DURATIONS_S)
def test_histograms_of_epochs_are_added_and_a_longer_histogram_replaces_its_earlier_version(
    first: list[float], second: list[float]
) -> None:
    durations = MonotonicHistogram()
    for part, epoch in ((first[:3], 1), (first, 1), (second, 2)):
        durations.update(counted(part), epoch)
    assert sum(durations.counts()) == len(first) + len(second)
    true_s = sum(first) + sum(second)
    assert abs(durations.sum_s - true_s) <= true_s / 64 + 1e-9 * (len(first) + len(second))


@given(st.floats(0.0, 3.0))
def test_each_duration_is_in_a_bucket_whose_bounds_differ_by_at_most_a_thirty_second(
    duration_s: float,
) -> None:
    durations = MonotonicHistogram()
    durations.update(counted([duration_s]))
    (place,) = [place for place, count in enumerate(durations.counts()) if count]
    exact_ns = int(duration_s * 1e9)
    if place < len(BOUNDS_NS):
        assert exact_ns <= BOUNDS_NS[place]
    if place > 0:
        assert exact_ns * 33 / 32 + 1 >= BOUNDS_NS[place - 1]


def test_bounds_increase_and_every_bucket_of_the_histogram_belongs_to_one_of_them() -> None:
    assert list(BOUNDS_S) == sorted(set(BOUNDS_S))
    places = [bound_index(bucket) for bucket in range(BUCKETS)]
    assert places == sorted(places)
    assert set(places) == set(range(len(BOUNDS_S) + 1))
    for place, bound_ns in enumerate(BOUNDS_NS):
        last = max(bucket for bucket, at in enumerate(places) if at == place)
        assert first_ns(last + 1) - 1 <= bound_ns < first_ns(last + 2) - 1
