"""A machine that was suspended: only one of two clocks counts that time, and the loop is
informed."""

from dataclasses import dataclass
from time import CLOCK_BOOTTIME, CLOCK_MONOTONIC

import pytest

from pincette.bus.memory import MemoryBus
from pincette.config import read_rig
from pincette.core.messages import Arm, Reset
from pincette.engine.loop import Loop
from pincette.engine.realtime.sleep_watch import APART_S, LEAST_S, SleepWatch
from pincette.engine.replay.service_alone import Tape
from pincette.engine.runner import Runner
from pincette_actuator import SERVICE
from tests.support.rigs import DEMO


@dataclass
class Hand:
    """Both clocks, set by the test."""

    awake_s: float = 100.0
    slept_s: float = 0.0
    put_off_s: float = 0.0
    """Delay of the program before the reading after the next, in s."""

    def __call__(self, clock: int) -> float:
        if clock == CLOCK_BOOTTIME:
            now_s = self.awake_s + self.slept_s
            self.awake_s += self.put_off_s
            return now_s
        assert clock == CLOCK_MONOTONIC
        return self.awake_s


def test_nothing_is_reported_while_the_machine_is_awake() -> None:
    hand = Hand()
    watch = SleepWatch(hand)
    for _ in range(10):
        assert watch.slept_s() == 0.0
        hand.awake_s += 5.0


def test_a_suspension_is_reported_once_with_its_length() -> None:
    hand = Hand(slept_s=7.0)
    watch = SleepWatch(hand)
    assert watch.slept_s() == 0.0, "a suspension before the start must not count"
    hand.slept_s += 3600.0
    assert watch.slept_s() == pytest.approx(3600.0)
    assert watch.slept_s() == 0.0
    hand.slept_s += 0.5 * LEAST_S
    assert watch.slept_s() == 0.0


def test_a_preemption_between_the_two_clock_readings_is_not_mistaken_for_a_suspension() -> None:
    hand = Hand()
    watch = SleepWatch(hand)
    watch.slept_s()
    hand.put_off_s = 2.0 * APART_S
    hand.slept_s += 1.0
    assert watch.slept_s() == 0.0
    hand.put_off_s = 0.0
    assert watch.slept_s() == pytest.approx(1.0), "the suspension must be reported later"


def test_the_loop_reports_a_suspension_to_its_actuator_which_trips() -> None:
    rig, hand = read_rig(DEMO), Hand()
    runner = Runner(SERVICE, rig, Tape())
    loop = Loop([runner], MemoryBus(), sleep_watch=SleepWatch(hand))
    runner.call(Reset(acknowledge=True), 0.0)
    loop.begin(0.0)
    loop.run_once()
    runner.call(Arm(1, 1, rig.digest()), 0.0)
    assert runner.state.mode == "armed"
    hand.slept_s += 2.0
    loop.run_once()
    assert (runner.state.mode, runner.state.cause) == ("latched", "suspend")
