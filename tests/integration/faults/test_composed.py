"""Faults of a loop of which several services are one program, in virtual time.

What a fault does, and within which bounds, is as with a program for each service; but one that
hangs or dies takes with it all that it composes, the actuator too where that is among them.
"""

import random
from itertools import pairwise
from math import isfinite, nan
from typing import Any

import pytest

from pincette.control.record import replace
from pincette.core.faults import Cause
from pincette.core.messages import Estimate, Trip
from pincette.core.service import AnyService
from pincette_estimator import SERVICE as ESTIMATOR
from tests.support.reactions import REACTION_S, TRIPPED
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_catalogue import FATAL, HARMLESS, HUNG_S, befalling
from tests.support.virtual_loop_injection import Fault, inject
from tests.support.virtual_loop_places import T, composed_place

SEED = 20130501
MOVING = ("approach", "hold")
TOGETHER = [
    ("loop",),
    ("estimator+controller",),
    ("controller+actuator",),
    ("sensor+estimator",),
    ("sensor+actuator", "estimator+controller"),
]
WATCHDOG_S, TICK_S = 0.5, 0.05
AFTER_S = 0.3
BENCH = [fault for fault in FATAL if fault.deed == "bench"]
PHASES = (0.02, 0.27, 0.52, 0.77, 0.97)


def loop_in(state: str, *programs: str, seed: int = 1) -> VirtualLoop:
    return composed_place(state, *programs).loop.fork(seed)


@pytest.mark.parametrize("programs", TOGETHER, ids=" and ".join)
@pytest.mark.parametrize("state", MOVING)
def test_what_befalls_a_program_does_what_it_does_to_a_service(
    state: str, programs: tuple[str, ...]
) -> None:
    place = composed_place(state, *programs)
    faults = [*befalling(place.loop.rig, FATAL), *befalling(place.loop.rig, HARMLESS)]
    assert {fault.must for fault in faults} == {"trip", "carry on"}
    for fault in faults:
        chance = random.Random(f"{SEED} {fault.name} {state} {programs}")
        reaction = inject(place, fault, chance.random(), chance.getrandbits(32))
        assert (reaction is not None) == (fault.must == "trip"), fault.name


@pytest.mark.parametrize("fault", BENCH, ids=lambda fault: fault.name)
@pytest.mark.parametrize("state", MOVING)
def test_one_program_notices_its_sensor_s_failure_at_any_time_within_a_period(
    state: str, fault: Fault
) -> None:
    for phase in PHASES:
        assert inject(composed_place(state, "loop"), fault, phase, seed=round(100 * phase))


@pytest.mark.parametrize("state", MOVING)
def test_an_emergency_stop_acts_within_a_period(state: str) -> None:
    for phase in PHASES:
        loop = loop_in(state, "loop")
        loop.run(loop.now_s + phase * T)
        asked_s = loop.now_s
        loop.must("actuator", Trip(Cause.ESTOP))
        loop.run(asked_s + REACTION_S)
        tripped = [(at_s, echo) for at_s, echo in loop.applied if echo.state in TRIPPED]
        assert tripped[0][0] - asked_s <= T
        assert tripped[0][1].state == ("frozen" if state == "hold" else "ramping")


@pytest.mark.parametrize("hung_s", HUNG_S)
@pytest.mark.parametrize("state", MOVING)
def test_a_program_that_hangs_moves_nothing_and_does_not_jump_afterwards(
    state: str, hung_s: float
) -> None:
    loop = loop_in(state, "loop")
    hung_at_s = loop.now_s
    loop.stop("loop", hung_s)
    loop.run(hung_at_s + hung_s)
    # A voltage that was accepted before may still be on its way.
    assert all(at_s < hung_at_s + T / 4 for at_s, _ in loop.put_out)
    loop.run(loop.now_s + AFTER_S)
    voltages_V = [put_V for _, put_V in loop.put_out]
    slew_V = loop.rig.limits.slew_V_per_s * T + 0.001
    if loop.newest.state == "armed":
        assert all(abs(later - one) <= slew_V for one, later in pairwise(voltages_V))
    assert not loop.bench.module.tripped


@pytest.mark.parametrize("state", MOVING)
def test_where_the_program_dies_the_output_s_module_is_safe_by_itself(state: str) -> None:
    loop = loop_in(state, "loop")
    loop.kill("loop")
    loop.run(loop.now_s + WATCHDOG_S + TICK_S + T)
    assert loop.bench.module.tripped
    assert loop.put_out_by_module() == 0.0


def test_what_is_no_number_inside_a_program_never_becomes_a_voltage() -> None:
    loop = loop_in("approach", "loop")
    loop.task("estimator").node.service = _without_numbers(ESTIMATOR)
    begun_s = loop.now_s
    loop.run(begun_s + 2.0 * REACTION_S)
    assert any(
        isinstance(one, Estimate) and one.force_mN != one.force_mN for _, one in loop.told or []
    )
    assert loop.newest.state in (*TRIPPED, "latched")
    assert all(isfinite(put_V) for _, put_V in loop.put_out)


def _without_numbers(service: AnyService) -> AnyService:
    """The service, but its force is no number."""

    def step(*given: Any) -> Any:
        state, outputs = service.step(*given)
        return state, tuple(replace(one, force_mN=nan) for one in outputs)

    return replace(service, step=step)
