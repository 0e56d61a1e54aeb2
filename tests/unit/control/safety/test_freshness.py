"""Ages by the clock and by numbers, and the stalls of the actuator that are discounted."""

from dataclasses import replace

import pytest

from pincette.control.safety.freshness import (
    ARRIVALS_KEPT,
    Arrival,
    Arrivals,
    arrival_of,
    newest_seq,
    skipped_seq,
    standstill_s,
    too_old,
    with_sample,
)
from pincette.core.wording import fault_text

from .bench import LIMITS, T

AGE = LIMITS.age
SEEN = tuple(Arrival(seq, seq * T, (1.0,)) for seq in range(4))


def test_samples_are_stored_in_order_up_to_a_limit() -> None:
    arrivals: Arrivals = ()
    assert newest_seq(arrivals) == -1
    for seq in range(20):
        arrivals = with_sample(arrivals, seq, seq * T, (float(seq),))
        assert newest_seq(arrivals) == seq
        assert len(arrivals) == min(seq + 1, ARRIVALS_KEPT)
    assert min(arrival.seq for arrival in arrivals) == 12
    assert arrival_of(arrivals, 12) == Arrival(12, 12 * T, (12.0,))
    assert arrival_of(arrivals, 11) is None
    assert arrival_of(arrivals, 20) is None


@pytest.mark.parametrize("seq", [3, 2, 0, -1])
def test_an_older_or_equal_sample_changes_nothing(seq: int) -> None:
    assert with_sample(SEEN, seq, 9.0, (9.0,)) is SEEN


def test_a_late_command_is_refused_by_its_age() -> None:
    sample = SEEN[3]
    assert too_old(AGE, SEEN, sample, sample.at_s + 0.0499) is None
    assert fault_text(too_old(AGE, SEEN, sample, sample.at_s + 0.051)) == "51 ms old, limit 50 ms"


def test_an_age_is_reported_to_the_millisecond() -> None:
    slow = replace(AGE, limit_s=2.0)
    assert fault_text(too_old(slow, SEEN, SEEN[3], 3.06)) == "3000 ms old, limit 2000 ms"


def test_an_age_at_the_limit_is_not_exceeded() -> None:
    assert too_old(AGE, (Arrival(0, 0.0, (1.0,)),), Arrival(0, 0.0, (1.0,)), 0.05) is None


def test_a_sample_delayed_in_a_queue_is_refused_by_its_sequence_number() -> None:
    burst = tuple(Arrival(seq, 1.0, (1.0,)) for seq in range(4))
    assert too_old(AGE, burst, burst[1], 1.001) is None
    assert fault_text(too_old(AGE, burst, burst[0], 1.001)) == "3 samples old, limit 2"


@pytest.mark.parametrize(
    ("slept_s", "excused_s", "standstill"),
    [
        (0.005, 0.0, None),
        (0.010, 0.0, None),
        (0.030, 0.0, 0.025),
        (0.305, 0.0, 0.2),
        (0.105, 0.15, 0.05),
        (0.105, 0.2, 0.0),
    ],
)
def test_a_stall_is_excused_up_to_a_limit(
    slept_s: float, excused_s: float, standstill: float | None
) -> None:
    found = standstill_s(AGE, slept_s, excused_s)
    assert found == (None if standstill is None else pytest.approx(standstill))


def test_a_skipped_sequence_number_is_reported() -> None:
    seen = with_sample((), 3, 0.06, (1.0,))
    assert [skipped_seq(seen, seq) for seq in (2, 3, 4, 5, 9)] == [-1, -1, -1, 4, 8]
    assert skipped_seq((), 7) == -1
