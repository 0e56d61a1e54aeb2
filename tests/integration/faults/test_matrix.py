"""Fault × job state × phase of the cycle, in virtual time, each judged separately."""

import os
import random
from pathlib import Path

import pytest

from tests.support.virtual_loop_campaign import (
    PHASES,
    arm_of,
    campaign,
    rows_of,
    table,
    write_figures,
)
from tests.support.virtual_loop_catalogue import FATAL, HARMLESS, LOST_ONCE
from tests.support.virtual_loop_injection import Fault, inject
from tests.support.virtual_loop_places import STATES, place

SEED = 20130501
MANY, PROCESSES = 100_000, 2
MOVING = tuple(state for state in STATES if state != "idle")


def drawn(fault: Fault, state: str) -> tuple[float, int]:
    """Draw the time of the fault within the period, and the seed of the machine's delays."""
    chance = random.Random(f"{SEED} {fault.name} {state}")
    return chance.random(), chance.getrandbits(32)


@pytest.mark.parametrize("state", MOVING)
def test_a_loop_with_a_severe_fault_becomes_safe_in_time_and_stays_safe(state: str) -> None:
    for fault in FATAL:
        phase, seed = drawn(fault, state)
        assert inject(place(state), fault, phase, seed) is not None


@pytest.mark.parametrize("state", MOVING)
def test_a_loop_with_a_slight_fault_continues(state: str) -> None:
    for fault in HARMLESS:
        phase, seed = drawn(fault, state)
        assert inject(place(state), fault, phase, seed) is None


@pytest.mark.parametrize("part", range(PHASES))
def test_a_controller_may_die_at_any_time_within_a_period(part: int) -> None:
    chance = random.Random(f"{SEED} {part}")
    for state in ("approach", "hold"):
        phase = (part + chance.random()) / PHASES
        reaction = inject(place(state), FATAL[2], phase, chance.getrandbits(32))
        assert reaction is not None
        assert reaction.held == (state == "hold")


def test_an_idle_rig_does_not_trip_and_does_not_move() -> None:
    for fault in (*FATAL, *HARMLESS):
        phase, seed = drawn(fault, "idle")
        assert inject(place("idle"), fault, phase, seed) is None


@pytest.mark.parametrize("fault", LOST_ONCE, ids=[fault.name for fault in LOST_ONCE])
def test_one_lost_sample_skips_one_tick(fault: Fault) -> None:
    for state in ("approach", "hold"):
        phase, seed = drawn(fault, state)
        assert inject(place(state), fault, phase, seed) is None


@pytest.mark.slow
def test_a_hundred_thousand_injected_faults_are_survived(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def tell(text: str) -> None:
        with capsys.disabled():
            print(text, flush=True)

    count = int(os.environ.get("PINCETTE_INJECTIONS", MANY))
    tell(f"seed {SEED}")
    reactions = campaign(count, SEED, PROCESSES, tell)
    tell(table("fault", rows_of(reactions, lambda reaction: reaction.fault)))
    tell(table("state of the job", rows_of(reactions, lambda reaction: reaction.state)))
    tell(table("arm", rows_of(reactions, arm_of)))
    if folder := os.environ.get("PINCETTE_FIGURES"):
        tell(f"written: {write_figures(Path(folder), reactions, count, SEED)}")
    assert len(reactions) >= 0.5 * count
