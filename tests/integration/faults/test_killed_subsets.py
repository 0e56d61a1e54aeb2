"""Row 10: whatever programs are killed and restarted, in whatever state, a person must reset.

Every subset of the eight programs of a rig, in every state of a job: the loop's four, the simulated
rig with its instruments, the router, the recorder and the supervisor.
"""

import random
from collections.abc import Iterator, Sequence
from itertools import combinations

import pytest

from pincette.core.messages import Reset
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_bench import scripted
from tests.support.virtual_loop_places import FREEZE_S, STATES, T, place
from tests.support.virtual_supervisor import Notes, VirtualSupervisor

OF_THE_LOOP = ("sensor", "estimator", "controller", "actuator")
PROGRAMS = (*OF_THE_LOOP, "rig", "router", "recorder", "supervisor")
AWAY_S = (0.03, 0.3)
"""Times until the restart: at once, and after the loop has come to rest."""
SEED = 21
DRAWN, DRAWN_IN_FULL = 4, 24
"""Number of subsets of each state in the short tests."""


def subsets() -> Iterator[tuple[str, ...]]:
    for count in range(len(PROGRAMS) + 1):
        yield from combinations(PROGRAMS, count)


def drawn(state: str, count: int) -> list[tuple[str, ...]]:
    """Draw some subsets, half of which include the actuator."""
    chance = random.Random(f"{SEED} {state}")
    every = [one for one in subsets() if one]
    with_it = [one for one in every if "actuator" in one]
    return chance.sample(with_it, count // 2) + chance.sample(every, count // 2)


def check(state: str, killed: Sequence[str], away_s: float) -> None:
    """Kill, restart, and try a job three times: the latch remains until a person clears it."""
    case = f"{'+'.join(killed) or 'nothing'} killed in {state} for {away_s} s"
    loop = place(state).loop.fork(SEED)
    loop.told = []
    notes = Notes()
    supervisor = VirtualSupervisor(loop, notes)
    loop.run(loop.now_s + T)
    supervisor.before_a_job()
    hurt_s = loop.now_s
    for name in killed:
        if name in OF_THE_LOOP:
            loop.kill(name)
    if "rig" in killed:
        loop.bench.order(scripted("sensor", "off", for_s=away_s))
        loop.bench.order(scripted("output", "off", for_s=away_s))
    loop.run(hurt_s + away_s)
    for name in killed:
        if name in OF_THE_LOOP:
            loop.restart(name)
    if {"supervisor", "router"} & set(killed):
        supervisor = VirtualSupervisor(loop, notes)
    loop.run(loop.now_s + FREEZE_S + 0.3)
    tries(loop, supervisor, "actuator" in killed, hurt_s, case)


def tries(
    loop: VirtualLoop, supervisor: VirtualSupervisor, died: bool, hurt_s: float, said: str
) -> None:
    tripped = died or any(
        echo.state in ("frozen", "ramping", "latched")
        for at_s, echo in loop.applied
        if at_s > hurt_s
    )
    for _ in range(3):
        reason = supervisor.before_a_job()
        loop.run(loop.now_s + 2.0 * T)
        mode = loop.runner("actuator").state.mode
        if tripped:
            assert mode == "latched", f"{said}: {mode} without a person"
            assert reason is not None, f"{said}: a job could start"
            moved_V = {put_V for at_s, put_V in loop.put_out if at_s > loop.now_s - 2.0 * T}
            assert len(moved_V) <= 1, f"{said}: it moves: {moved_V}"
    if tripped:
        assert isinstance(loop.call("actuator", Reset(acknowledge=False)), str), said
        supervisor.health.reset()
        loop.run(loop.now_s + 2.0 * T)
        assert loop.runner("actuator").state.mode == "idle", said
        assert supervisor.before_a_job() is None, said


@pytest.mark.parametrize("state", STATES)
def test_after_programs_were_killed_only_a_person_can_make_the_rig_idle(state: str) -> None:
    for killed in drawn(state, DRAWN):
        check(state, killed, AWAY_S[len(killed) % 2])


def test_a_restart_of_killed_actuator_and_supervisor_clears_no_latch() -> None:
    for state in STATES:
        check(state, ("actuator", "supervisor"), 0.03)


@pytest.mark.full
@pytest.mark.parametrize("state", STATES)
def test_after_many_sets_of_programs_were_killed_only_a_person_can_make_the_rig_idle(
    state: str,
) -> None:
    for killed in drawn(state, DRAWN_IN_FULL):
        check(state, killed, AWAY_S[len(killed) % 2])


@pytest.mark.slow
@pytest.mark.parametrize("state", STATES)
def test_any_subset_of_programs_may_be_killed_in_any_state(state: str) -> None:
    for killed in subsets():
        check(state, killed, AWAY_S[len(killed) % 2])


def test_a_rig_without_killed_programs_can_be_used_without_a_reset() -> None:
    loop = VirtualLoop(place("idle").loop.rig)
    loop.run(3.0 * T)
    assert VirtualSupervisor(loop, Notes()).before_a_job() is None
    assert loop.runner("actuator").state.mode == "idle"
