"""Row 10, with real processes: programs are killed and started together, and who is asked then."""

import random
import signal

import pytest

from tests.support.grips import (
    approach,
    hold,
    kill,
    make_ready,
    refused,
    reset,
    restart,
    whole_grip,
)
from tests.support.running import RunningRig
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls")

PROGRAMS = ("sensor", "estimator", "controller", "actuator", "supervisor", "recorder", "router")
SEED, SUBSETS = 21, 20


@pytest.fixture(autouse=True)
def ready(rig: RunningRig) -> None:
    make_ready(rig)


def asks_a_person(rig: RunningRig, seen: Witness) -> None:
    """A job is refused until somebody resets the rig, and then runs."""
    assert refused(rig)["type"].endswith("rig-latched")
    reset(rig)
    make_ready(rig)
    whole_grip(rig, seen)


@pytest.mark.parametrize("names", [("actuator", "supervisor"), ("supervisor", "actuator")])
def test_actuator_and_supervisor_killed_and_started_clear_no_latch(
    rig: RunningRig, seen: Witness, names: tuple[str, ...]
) -> None:
    approach(rig, seen)
    for name in names:
        kill(rig, name)
    for name in names:
        restart(rig, name)
    asks_a_person(rig, seen)


def test_an_actuator_that_was_told_to_end_at_rest_asks_nobody_when_both_start_again(
    rig: RunningRig, seen: Witness
) -> None:
    for name in ("supervisor", "actuator"):
        rig.fleet.signal(name, signal.SIGTERM)
    for name in ("actuator", "supervisor"):
        restart(rig, name)
    whole_grip(rig, seen)


@pytest.mark.full
def test_an_actuator_that_was_told_to_end_with_a_part_held_asks_a_person(
    rig: RunningRig, seen: Witness
) -> None:
    """Its ramp lets the part go; whoever starts it again is told."""
    hold(rig, seen)
    for name in ("actuator", "supervisor"):
        rig.fleet.signal(name, signal.SIGTERM)
    for name in ("actuator", "supervisor"):
        restart(rig, name)
    asks_a_person(rig, seen)


@pytest.mark.slow
def test_twenty_subsets_of_killed_programs(rig: RunningRig, seen: Witness) -> None:
    chance = random.Random(SEED)
    for _ in range(SUBSETS):
        names = chance.sample(PROGRAMS, chance.randint(1, len(PROGRAMS)))
        make_ready(rig)
        begin = chance.choice((approach, hold))
        begin(rig, seen)
        for name in names:
            kill(rig, name)
        for name in names:
            restart(rig, name)
        if {"sensor", "estimator", "controller", "actuator"} & set(names):
            asks_a_person(rig, seen)
