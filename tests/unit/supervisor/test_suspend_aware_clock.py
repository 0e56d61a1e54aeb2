"""A clock that stops while its program is stalled, and the detection of silent programs by it."""

from dataclasses import dataclass
from time import monotonic, sleep

import pytest

from pincette.config import RigFile
from pincette.core.messages import Position
from pincette.core.messages.arms import ArmPosition
from pincette_supervisor.process_load import GRID_S, ProcessLoad
from pincette_supervisor.rigs.observer import SAMPLE_COUNTS_S, Observer, SuspendAwareClock

from .canned import CannedRig


@dataclass
class Hand:
    """The time of a clock, which a test advances."""

    now_s: float = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_while_awake_the_clock_follows_the_system_clock() -> None:
    hand = Hand()
    suspend_aware_clock = SuspendAwareClock(hand)
    for _ in range(60):
        hand.now_s += GRID_S
        suspend_aware_clock.sample()
    assert suspend_aware_clock() == pytest.approx(60 * GRID_S)
    hand.now_s += 0.02
    assert suspend_aware_clock() == pytest.approx(60 * GRID_S + 0.02)


def test_the_clock_stops_without_samples() -> None:
    hand = Hand()
    suspend_aware_clock = SuspendAwareClock(hand)
    hand.now_s += 3600.0
    assert suspend_aware_clock() == SAMPLE_COUNTS_S
    suspend_aware_clock.sample()
    assert suspend_aware_clock() == SAMPLE_COUNTS_S


def test_a_sensor_is_not_judged_silent_by_a_suspended_process(rig_file: RigFile) -> None:
    hand = Hand()
    suspend_aware_clock = SuspendAwareClock(hand)
    bus = CannedRig(rig_file)
    observer = Observer(bus, hand, suspend_aware_clock)
    assert observer.silent_s(Position) is None
    bus.publish(Position(0, 1, 0.02, (ArmPosition(0.0),)))
    hand.now_s += 5.0
    suspend_aware_clock.sample()
    assert observer.age_s(Position) == pytest.approx(5.0)
    assert observer.silent_s(Position) == pytest.approx(SAMPLE_COUNTS_S)
    for _ in range(4):
        hand.now_s += GRID_S
        suspend_aware_clock.sample()
    assert observer.silent_s(Position) == pytest.approx(SAMPLE_COUNTS_S + 4 * GRID_S)


def test_a_thread_samples_the_clock_until_it_is_closed() -> None:
    suspend_aware_clock, process_load = SuspendAwareClock(), ProcessLoad()
    process_load.start(suspend_aware_clock.sample)
    deadline = monotonic() + 10.0
    while suspend_aware_clock() <= 2.0 * SAMPLE_COUNTS_S:
        assert monotonic() < deadline, "nobody looks"
        sleep(0.01)
    process_load.close()
    sleep(1.5 * SAMPLE_COUNTS_S)
    stood_s = suspend_aware_clock()
    sleep(0.01)
    assert suspend_aware_clock() == stood_s
