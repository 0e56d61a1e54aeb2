"""Row 10, with real processes: programs are killed and started together; when a person must
reset."""

import random
import signal
from collections.abc import Collection
from time import monotonic, sleep

import pytest

from pincette.core.topics import LOOP
from pincette.engine.fleet import NEEDED_FIRST, FleetError
from tests.support.grips import (
    FREEZE_S,
    approach,
    hold,
    kill,
    make_ready,
    refused,
    reset,
    restart,
    wait_for_any_phase,
    whole_grip,
)
from tests.support.running import RunningRig
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls", "ready")

PROGRAMS = (*LOOP, "rig", "router", "recorder", "supervisor")
TRIP = {*LOOP, "rig"}
"""Programs whose death trips the actuator of an armed rig."""
SEED, FEW, MANY = 21, 2, 20
AWAY_S = (0.0, FREEZE_S + 0.6)
"""Times until the restart: at once, and after the actuator has come to rest."""
READY_S = 20.0
"""Longest time until a rig with restarted programs can start a job, in s."""
BEGIN = {"idle": None, "approach": approach, "hold": hold}


def asks_a_person(rig: RunningRig, seen: Witness) -> None:
    """Check that a job is refused until a person resets the rig, and then runs.

    The job before it may still be ending, since the supervisor links to a new router later.
    """
    deadline = monotonic() + READY_S
    while (problem := refused(rig))["type"].endswith("job-active"):
        assert monotonic() < deadline
        sleep(0.05)
    assert problem["type"].endswith("rig-latched")
    reset(rig)
    make_ready(rig, READY_S)
    whole_grip(rig, seen)


def start_again(rig: RunningRig, names: Collection[str]) -> None:
    """Start programs together; on a busy machine eight of them take longer than a fleet waits."""
    try:
        restart(rig, *names)
    except FleetError:
        if any(not rig.fleet.members[name].ready.wait(READY_S) for name in names):
            raise


def test_a_restart_of_killed_actuator_and_supervisor_clears_no_latch(
    rig: RunningRig, seen: Witness
) -> None:
    approach(rig, seen)
    for name in ("actuator", "supervisor"):
        kill(rig, name)
    for name in ("actuator", "supervisor"):
        restart(rig, name)
    asks_a_person(rig, seen)


@pytest.mark.full
def test_an_actuator_stopped_with_a_part_held_needs_a_person(
    rig: RunningRig, seen: Witness
) -> None:
    """The ramp of the actuator releases the part; the next start reports this."""
    hold(rig, seen)
    for name in ("actuator", "supervisor"):
        rig.fleet.signal(name, signal.SIGTERM)
    for name in ("actuator", "supervisor"):
        restart(rig, name)
    asks_a_person(rig, seen)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def test_any_subset_of_programs_may_be_killed_and_restarted(
    rig: RunningRig, seen: Witness, count: int, figures: list[str]
) -> None:
    """If an armed rig has lost a program of its loop, or any rig its actuator, a person must
    reset; otherwise not. In both cases the next grip succeeds."""
    seed = SEED if count == FEW else random.SystemRandom().randrange(2**32)
    chance = random.Random(seed)
    requested = 0
    for number in range(count):
        names = chance.sample(PROGRAMS, chance.randint(1, len(PROGRAMS)))
        state, away_s = chance.choice(list(BEGIN)), chance.choice(AWAY_S)
        case = f"seed {seed}, {number + 1}: {'+'.join(names)} in {state}, away {away_s:g} s"
        print(case)
        make_ready(rig, READY_S)
        if (begin := BEGIN[state]) is not None:
            begin(rig, seen)
        wait_for_any_phase(chance, rig.rig.rig.period_s)
        for name in names:
            kill(rig, name)
        sleep(away_s)
        for those in (set(names) & set(NEEDED_FIRST), set(names) - set(NEEDED_FIRST)):
            start_again(rig, those)
        if "rig" in names and "estimator" not in names:
            # A new simulated arm has no history, unlike a real one: the estimator, which knew the
            # previous arm, is restarted with it.
            kill(rig, "estimator")
            restart(rig, "estimator")
        if "actuator" in names or (begin is not None and TRIP & set(names)):
            asks_a_person(rig, seen)
            requested += 1
        else:
            make_ready(rig, READY_S)
            whole_grip(rig, seen)
    figures.append(
        f"{count} subsets of killed programs, seed {seed}: a person was asked {requested} x"
    )
