"""A grip whose instruments reply late, twice or never ends with the right force, or with a trip.

The loop is in virtual real time, with the drivers' own bytes over lines whose replies are delayed.
A reading that was mistaken for the reply to the next request would be a period old or more: the
grip would continue to press for that time, and end as if nothing had been wrong.
"""

import logging

import pytest

from pincette.core.faults import Cause
from pincette.core.messages import Applied
from tests.support.delayed_answers import Delays, constant, drawn, single
from tests.support.delayed_rig import AT_ONCE_S, Grip, grip

FORCE_MN = 8.0
LARGEST_MN = 8.6
"""Largest true force of the same grip if the sensor replies at once, plus a margin of 0.2 mN for
readings as old as are accepted."""
T = 0.02
IN_TIME_S = {False: 0.8 * T, True: 0.0058}
"""Time that the loop waits for the sensor, in s: as a separate program, or in one with all
others."""
SEED = 20261127


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> None:
    """Keep the lines' warnings out of the report of a failed test."""
    caplog.set_level(logging.ERROR)


def check_right_or_tripped(came: Grip) -> None:
    assert came.peak_mN <= LARGEST_MN
    if came.trip is None and came.outcome != "zero_refused":
        assert came.outcome == "gripped"
        assert came.peak_mN >= 0.98 * FORCE_MN


@pytest.mark.parametrize("composed", [False, True])
@pytest.mark.parametrize("delay_s", [0.0056, 0.0060, 0.0158, 0.017, 0.13])
def test_a_grip_with_late_readings_has_the_right_force_or_trips(
    delay_s: float, composed: bool
) -> None:
    came = grip(constant(delay_s), composed=composed)
    check_right_or_tripped(came)
    in_time = delay_s < IN_TIME_S[composed]
    assert (came.trip is None) == in_time
    assert bool(came.counts.late) != in_time
    if not in_time:
        assert came.last.cause == Cause.COMMAND_AGE
        assert came.named_late, "the cause must state that answers arrive late"


@pytest.mark.parametrize("composed", [False, True])
@pytest.mark.parametrize("from_s", [0.5, 1.75, 2.1, 3.0])
def test_a_line_may_become_slow_during_a_grip(from_s: float, composed: bool) -> None:
    """In the approach, before the contact, in the load and in the hold."""
    came = grip(constant(0.042), composed=composed, from_s=from_s)
    assert came.peak_mN <= LARGEST_MN
    assert came.trip is not None
    assert came.named_late


@pytest.mark.parametrize("composed", [False, True])
@pytest.mark.parametrize("every", [10, 40])
def test_single_late_or_lost_answers_are_tolerated(every: int, composed: bool) -> None:
    late: Delays = single(1.05 * T, every, AT_ONCE_S)

    def lost(number: int) -> list[float]:
        return [] if number % every == every - 1 else [AT_ONCE_S]

    for delays in (late, lost):
        came = grip(delays, composed=composed)
        assert came.trip is None
        check_right_or_tripped(came)
        assert came.counts.late + came.counts.lost >= 4


@pytest.mark.parametrize("composed", [False, True])
def test_if_a_reading_is_lost_the_zero_is_taken_at_a_later_reading(composed: bool) -> None:
    zeroes: set[int] = set()

    def is_first_after_zero(echo: Applied) -> bool:
        if not echo.zero or echo.seq in zeroes:
            return False
        zeroes.add(echo.seq)
        return True

    came = grip(constant(AT_ONCE_S), composed=composed, from_s=0.1, loses=is_first_after_zero)
    assert len(zeroes) == 2, "each of the two zeros of the program must be requested once"
    assert came.counts.lost == 2
    assert came.trip is None
    assert came.outcome == "gripped"
    assert came.peak_mN >= 0.98 * FORCE_MN


@pytest.mark.parametrize("composed", [False, True])
@pytest.mark.parametrize("seed", range(SEED, SEED + 1))
def test_a_grip_with_randomly_late_readings_has_the_right_force_or_trips(
    seed: int, composed: bool
) -> None:
    for most_s, lost, doubled in ((0.2 * T, 0.0, 0.05), (T, 0.0, 0.0), (3.0 * T, 0.05, 0.05)):
        print(f"seed {seed}, up to {most_s} s, lost {lost}, doubled {doubled}")
        delays = drawn(most_s, seed, lost=lost, doubled=doubled)
        check_right_or_tripped(grip(delays, composed=composed, split=seed % 2 == 1))


@pytest.mark.parametrize("delay_s", [0.01, 0.09, 0.11, 0.3])
def test_a_grip_succeeds_if_the_output_confirms_late(delay_s: float) -> None:
    came = grip(constant(delay_s), target="output", from_s=1.75)
    check_right_or_tripped(came)
    assert (came.trip is None) == (delay_s < T)


def test_in_many_cases_a_grip_has_the_right_force_or_trips() -> None:
    """Each delay from 0 to 3 timeouts, from each phase on, with losses and duplicates (long)."""
    for composed in (False, True):
        timeout_s = IN_TIME_S[composed]
        for tenths in range(31):
            for from_s in (0.5, 1.75, 2.1, 3.0):
                case = f"composed {composed}, {tenths} tenths from {from_s} s"
                print(case)
                delay_s = 0.1 * tenths * timeout_s
                check_right_or_tripped(grip(constant(delay_s), composed=composed, from_s=from_s))
                delays = drawn(delay_s, SEED + tenths, lost=0.03, doubled=0.03)
                check_right_or_tripped(grip(delays, composed=composed, from_s=from_s))
