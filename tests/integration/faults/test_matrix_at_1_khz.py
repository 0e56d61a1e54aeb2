"""Fault × job state at T = 1 ms in virtual time: age limit, ramp and freeze follow from this
period.

The complete matrix is tested at 20 ms. Four programs on a machine that keeps 1 ms, and all in one.
"""

import random

import pytest

from pincette.core.faults import Cause
from pincette.core.messages import Trip
from tests.support.reactions import TRIPPED
from tests.support.virtual_loop_campaign import PHASES
from tests.support.virtual_loop_catalogue import HUNG_SHORT_S, befalling, catalogue
from tests.support.virtual_loop_injection import REACTION_PERIODS, Fault, inject
from tests.support.virtual_loop_places import SHORT_S, STATES, composed_place, place

SEED = 20130501
FAULTS = catalogue(SHORT_S, HUNG_SHORT_S)
MOVING = tuple(state for state in STATES if state != "idle")
FEW = ("approach", "hold")
WATCHDOG_S, TICK_S = 0.5, 0.1
STEP_V = 0.001
"""Step to which the output rounds a voltage, in V."""


def drawn(fault: Fault, state: str) -> tuple[float, int]:
    chance = random.Random(f"{SEED} {fault.name} {state}")
    return chance.random(), chance.getrandbits(32)


@pytest.mark.parametrize("state", FEW)
def test_one_fault_of_each_class_is_handled_in_periods_of_1_ms(state: str) -> None:
    classes = {(fault.deed, fault.row, fault.must): fault for fault in FAULTS.fatal}
    for fault in classes.values():
        reaction = inject(place(state, SHORT_S), fault, *drawn(fault, state))
        assert reaction is not None
        assert reaction.held == (state == "hold")


@pytest.mark.parametrize("state", MOVING)
def test_a_loop_with_a_severe_fault_becomes_safe_in_time_and_stays_safe(state: str) -> None:
    for fault in FAULTS.fatal:
        assert inject(place(state, SHORT_S), fault, *drawn(fault, state)) is not None


@pytest.mark.parametrize("state", MOVING)
def test_a_loop_with_a_slight_fault_continues(state: str) -> None:
    for fault in (*FAULTS.harmless, *(FAULTS.lost_once if state in FEW else ())):
        assert inject(place(state, SHORT_S), fault, *drawn(fault, state)) is None


def test_an_idle_rig_does_not_trip_and_does_not_move() -> None:
    for fault in (*FAULTS.fatal, *FAULTS.harmless):
        assert inject(place("idle", SHORT_S), fault, *drawn(fault, "idle")) is None


@pytest.mark.parametrize("state", FEW)
def test_a_fault_of_the_composed_program_has_the_effect_of_the_same_fault_of_a_service(
    state: str,
) -> None:
    whole = composed_place(state, "loop", period_s=SHORT_S)
    faults = [
        *befalling(whole.loop.rig, FAULTS.fatal),
        *befalling(whole.loop.rig, FAULTS.harmless),
    ]
    assert {fault.must for fault in faults} == {"trip", "carry on"}
    for fault in faults:
        reaction = inject(whole, fault, *drawn(fault, state))
        assert (reaction is not None) == (fault.must == "trip"), fault.name


@pytest.mark.parametrize("state", FEW)
def test_a_controller_may_die_at_any_time_within_a_period(state: str) -> None:
    killed = next(one for one in FAULTS.fatal if (one.deed, one.who) == ("kill", "controller"))
    for part in range(PHASES):
        chance = random.Random(f"{SEED} {part} {state}")
        phase = (part + chance.random()) / PHASES
        reaction = inject(place(state, SHORT_S), killed, phase, chance.getrandbits(32))
        assert reaction is not None
        assert reaction.held == (state == "hold")


@pytest.mark.parametrize("programs", [(), ("loop",)], ids=["four", "one"])
@pytest.mark.parametrize("state", FEW)
def test_an_emergency_stop_acts_within_a_period(state: str, programs: tuple[str, ...]) -> None:
    for part in range(PHASES):
        at = composed_place(state, *programs, period_s=SHORT_S)
        loop = at.loop.fork(part)
        loop.run(loop.now_s + part / PHASES * SHORT_S)
        asked_s = loop.now_s
        loop.must("actuator", Trip(Cause.ESTOP))
        loop.run(asked_s + REACTION_PERIODS * SHORT_S)
        tripped = [(at_s, echo) for at_s, echo in loop.applied if echo.state in TRIPPED]
        assert tripped[0][0] - asked_s <= SHORT_S
        assert tripped[0][1].state == ("frozen" if state == "hold" else "ramping")


@pytest.mark.parametrize("hung_s", HUNG_SHORT_S)
@pytest.mark.parametrize("state", FEW)
def test_a_hanging_composed_program_moves_nothing_and_does_not_jump_afterwards(
    state: str, hung_s: float
) -> None:
    loop = composed_place(state, "loop", period_s=SHORT_S).loop.fork(1)
    hung_at_s = loop.now_s
    loop.stop("loop", hung_s)
    loop.run(hung_at_s + hung_s)
    # A voltage that was accepted before may still be in transit.
    assert all(at_s < hung_at_s + SHORT_S / 4 for at_s, _ in loop.put_out)
    put_V = loop.put_out[-1][1]
    loop.run(loop.now_s + SHORT_S)
    ramp_V = 2.0 * abs(put_V - loop.rig.safety.safe_V) * SHORT_S / loop.rig.safety.ramp_s
    assert loop.newest.state == ("frozen" if state == "hold" else "ramping")
    assert abs(loop.put_out[-1][1] - put_V) <= ramp_V + STEP_V


@pytest.mark.parametrize("state", FEW)
def test_if_the_composed_program_dies_the_output_module_becomes_safe_by_its_watchdog(
    state: str,
) -> None:
    loop = composed_place(state, "loop", period_s=SHORT_S).loop.fork(1)
    loop.kill("loop")
    loop.run(loop.now_s + WATCHDOG_S + TICK_S)
    assert loop.bench.module.tripped
    assert loop.put_out_by_module() == 0.0
