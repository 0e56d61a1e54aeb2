"""The wall clock is set while a record is open: the record's times continue, and the step is
stored."""

import pytest

from pincette_recorder.wall_clock import MOST, WallClock

HOUR_S = 3600.0


class Hands:
    """Both clocks of a machine, set by the test."""

    def __init__(self) -> None:
        self.wall_s, self.steady_s = 1_763_740_800.0, 500.0

    def wall_ns(self) -> int:
        return round(self.wall_s * 1e9)

    def steady_ns(self) -> int:
        return round(self.steady_s * 1e9)

    def pass_(self, seconds: float) -> None:
        self.wall_s += seconds
        self.steady_s += seconds


@pytest.mark.parametrize("step_s", [HOUR_S, -HOUR_S, 0.5, -0.5])
def test_a_step_of_the_wall_clock_is_noted_once_and_does_not_change_the_time(step_s: float) -> None:
    hands = Hands()
    clock = WallClock(hands.wall_ns, hands.steady_ns)
    before_ns = clock.now_ns()
    hands.pass_(12.3)
    clock.look()
    hands.wall_s += step_s
    for _ in range(3):
        clock.look()
        hands.pass_(0.05)
    assert clock.now_ns() - before_ns == pytest.approx(12.45e9, abs=1e3)
    assert clock.words() == f"the wall clock was set by {step_s:+.1f} s, 12.3 s after the start"


def test_a_clock_that_is_adjusted_slowly_is_not_reported_as_set() -> None:
    hands = Hands()
    clock = WallClock(hands.wall_ns, hands.steady_ns)
    for _ in range(1000):
        hands.pass_(1.0)
        hands.wall_s += 400e-6
        clock.look()
    assert clock.words() == ""


def test_the_next_record_starts_at_the_present_time_of_day() -> None:
    hands = Hands()
    clock = WallClock(hands.wall_ns, hands.steady_ns)
    hands.wall_s += HOUR_S
    clock.look()
    clock.begin()
    assert clock.now_ns() == hands.wall_ns()
    assert clock.words() == ""


def test_many_steps_are_counted() -> None:
    hands = Hands()
    clock = WallClock(hands.wall_ns, hands.steady_ns)
    for _ in range(MOST + 3):
        hands.wall_s += HOUR_S
        clock.look()
    assert clock.words().endswith("; and 3 times more")
