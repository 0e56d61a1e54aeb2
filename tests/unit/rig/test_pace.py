"""Lockstep is never faster than its pace, and does not catch up after stalls of the machine."""

import pytest

from pincette_rig.program import BEHIND_S, Pace


class Clock:
    """Advances by the waiting times, and by the test."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s

    def wait(self, time_s: float) -> None:
        self.now_s += time_s


@pytest.mark.parametrize(("pace", "took_s"), [(1.0, 2.0), (4.0, 0.5)])
def test_simulated_time_passes_at_the_configured_pace(pace: float, took_s: float) -> None:
    clock = Clock()
    paced = Pace(pace, clock, clock.wait)
    for tick in range(101):
        paced(0.02 * tick)
    assert clock.now_s - 100.0 == pytest.approx(took_s)


def test_a_short_delay_of_the_pace_is_caught_up_and_a_long_one_is_not() -> None:
    clock = Clock()
    paced = Pace(1.0, clock, clock.wait)
    clock.now_s += BEHIND_S / 2.0
    paced(0.0)
    paced(0.2)
    assert clock.now_s == pytest.approx(100.2)
    clock.now_s += 60.0
    paced(0.22)
    paced(0.24)
    assert clock.now_s == pytest.approx(160.22)
