"""A clock that stands still while its program does, and who is called silent by it."""

import threading
from dataclasses import dataclass
from time import monotonic, sleep

import pytest

from pincette.config import RigFile
from pincette.messages import Position
from pincette.topics import POSITION
from pincette_supervisor.running.observer import Observer
from pincette_supervisor.running.waking import LOOK_COUNTS_S, LOOK_S, Waking

from .canned import CannedRig


@dataclass
class Hand:
    """The hand of a clock, which a test turns."""

    now_s: float = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_awake_it_goes_as_the_clock_does() -> None:
    hand = Hand()
    waking = Waking(hand)
    for _ in range(60):
        hand.now_s += LOOK_S
        waking.look()
    assert waking() == pytest.approx(60 * LOOK_S)
    hand.now_s += 0.02
    assert waking() == pytest.approx(60 * LOOK_S + 0.02)


def test_it_stands_still_while_nobody_looks() -> None:
    hand = Hand()
    waking = Waking(hand)
    hand.now_s += 3600.0
    assert waking() == LOOK_COUNTS_S
    waking.look()
    assert waking() == LOOK_COUNTS_S


def test_a_sensor_was_not_silent_to_one_who_slept(rig_file: RigFile) -> None:
    hand = Hand()
    waking = Waking(hand)
    bus = CannedRig(rig_file)
    observer = Observer(bus, hand, waking)
    assert observer.silent_s(POSITION) is None
    bus.publish(Position(0, 1, 0.02, 0.0))
    hand.now_s += 5.0
    waking.look()
    assert observer.age_s(POSITION) == pytest.approx(5.0)
    assert observer.silent_s(POSITION) == pytest.approx(LOOK_COUNTS_S)
    for _ in range(4):
        hand.now_s += LOOK_S
        waking.look()
    assert observer.silent_s(POSITION) == pytest.approx(LOOK_COUNTS_S + 4 * LOOK_S)


def test_its_thread_looks_until_it_is_closed() -> None:
    waking = Waking()
    waking.begin()
    deadline = monotonic() + 10.0
    while waking() <= 2.0 * LOOK_COUNTS_S:
        assert monotonic() < deadline, "nobody looks"
        sleep(0.01)
    assert "waking" in {thread.name for thread in threading.enumerate()}
    waking.close()
    assert "waking" not in {thread.name for thread in threading.enumerate()}
