"""Fault × job state at T = 1 ms in virtual time: age limit, ramp and freeze are those of a period.

The whole matrix is that of 20 ms. Four programs on a machine that keeps 1 ms, and all in one.
"""

import random

import pytest

from tests.support.virtual_loop_catalogue import HUNG_SHORT_S, befalling, catalogue
from tests.support.virtual_loop_injection import Fault, inject
from tests.support.virtual_loop_places import SHORT_S, STATES, composed_place, place

SEED = 20130501
FAULTS = catalogue(SHORT_S, HUNG_SHORT_S)
MOVING = tuple(state for state in STATES if state != "idle")
FEW = ("approach", "hold")


def drawn(fault: Fault, state: str) -> tuple[float, int]:
    chance = random.Random(f"{SEED} {fault.name} {state}")
    return chance.random(), chance.getrandbits(32)


@pytest.mark.parametrize("state", FEW)
def test_one_fault_of_each_class_is_met_in_periods_of_1_ms(state: str) -> None:
    classes = {(fault.deed, fault.row, fault.must): fault for fault in FAULTS.fatal}
    for fault in classes.values():
        reaction = inject(place(state, SHORT_S), fault, *drawn(fault, state))
        assert reaction is not None
        assert reaction.held == (state == "hold")


@pytest.mark.parametrize("state", MOVING)
def test_a_loop_that_is_hurt_is_safe_in_time_and_stays_so(state: str) -> None:
    for fault in FAULTS.fatal:
        assert inject(place(state, SHORT_S), fault, *drawn(fault, state)) is not None


@pytest.mark.parametrize("state", MOVING)
def test_a_loop_that_is_hurt_a_little_goes_on(state: str) -> None:
    for fault in (*FAULTS.harmless, *(FAULTS.lost_once if state in FEW else ())):
        assert inject(place(state, SHORT_S), fault, *drawn(fault, state)) is None


def test_an_idle_rig_does_not_trip_and_does_not_move() -> None:
    for fault in (*FAULTS.fatal, *FAULTS.harmless):
        assert inject(place("idle", SHORT_S), fault, *drawn(fault, "idle")) is None


@pytest.mark.parametrize("state", FEW)
def test_what_befalls_one_program_does_what_it_does_to_a_service(state: str) -> None:
    whole = composed_place(state, "loop", period_s=SHORT_S)
    faults = [
        *befalling(whole.loop.rig, FAULTS.fatal),
        *befalling(whole.loop.rig, FAULTS.harmless),
    ]
    assert {fault.must for fault in faults} == {"trip", "carry on"}
    for fault in faults:
        reaction = inject(whole, fault, *drawn(fault, state))
        assert (reaction is not None) == (fault.must == "trip"), fault.name
