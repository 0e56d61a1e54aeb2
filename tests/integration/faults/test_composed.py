"""Faults of a loop in which several services are one program, in virtual time.

The effects and limits of a fault are those of separate programs; but a program that hangs or dies
stops all services that it contains, including the actuator if it is one of them.
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
from tests.support.arms import with_arm
from tests.support.reactions import REACTION_S, TRIPPED
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_catalogue import FATAL, HARMLESS, HUNG_S, befalling
from tests.support.virtual_loop_injection import Fault, inject
from tests.support.virtual_loop_places import SHORT_S, T, composed_place

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
HUNG_PERIODS = 4.0
"""Number of periods that a program hangs: longer than the age limit of a command, shorter than a
stall that is discounted."""
BENCH = [fault for fault in FATAL if fault.deed == "bench"]
PHASES = (0.02, 0.27, 0.52, 0.77, 0.97)


def loop_in(state: str, *programs: str, seed: int = 1) -> VirtualLoop:
    return composed_place(state, *programs).loop.fork(seed)


@pytest.mark.parametrize("programs", TOGETHER, ids=" and ".join)
@pytest.mark.parametrize("state", MOVING)
def test_a_fault_of_a_composed_program_has_the_effect_of_the_same_fault_of_a_service(
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
def test_a_composed_program_notices_a_sensor_failure_within_a_period(
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


@pytest.mark.parametrize(
    ("state", "service", "period_s"),
    [("approach", "estimator", T), ("hold", "controller", T), ("hold", "estimator", SHORT_S)],
)
def test_a_service_that_computes_too_long_trips_its_program_at_once(
    state: str, service: str, period_s: float
) -> None:
    """This is no stall of the machine, for which a command would be waited for."""
    loop = composed_place(state, "loop", period_s=period_s).loop.fork(1)
    program, hung_s = loop.program(service), HUNG_PERIODS * period_s
    program.slow_s, program.slow_service = hung_s, service
    begun_s = loop.now_s
    ended_s = begun_s + hung_s + period_s
    loop.run(ended_s)
    tripped = [(at_s, echo) for at_s, echo in loop.applied if echo.state in TRIPPED]
    assert hung_s <= tripped[0][0] - begun_s
    assert tripped[0][1].state == ("frozen" if state == "hold" else "ramping")
    if state != "hold":
        loop.run(ended_s + loop.rig.safety.ramp_s + period_s)
        assert loop.newest.state == "latched"
        assert loop.put_out[-1][1] == loop.rig.safety.safe_V


def test_a_stalled_machine_does_not_trip_a_composed_program() -> None:
    loop = loop_in("approach", "loop")
    loop.stop("loop", HUNG_PERIODS * T)
    loop.run(loop.now_s + AFTER_S)
    assert loop.newest.state == "armed"


@pytest.mark.parametrize("hung_s", HUNG_S)
@pytest.mark.parametrize("state", MOVING)
def test_a_program_that_hangs_moves_nothing_and_does_not_jump_afterwards(
    state: str, hung_s: float
) -> None:
    loop = loop_in(state, "loop")
    hung_at_s = loop.now_s
    loop.stop("loop", hung_s)
    loop.run(hung_at_s + hung_s)
    # A voltage that was accepted before may still be in transit.
    assert all(at_s < hung_at_s + T / 4 for at_s, _ in loop.put_out)
    loop.run(loop.now_s + AFTER_S)
    voltages_V = [put_V for _, put_V in loop.put_out]
    slew_V = loop.rig.limits.slew_V_per_s * T + 0.001
    if loop.newest.state == "armed":
        assert all(abs(later - one) <= slew_V for one, later in pairwise(voltages_V))
    assert not loop.bench.module.tripped


@pytest.mark.parametrize("state", MOVING)
def test_if_the_program_dies_the_output_module_becomes_safe_by_its_watchdog(state: str) -> None:
    loop = loop_in(state, "loop")
    loop.kill("loop")
    loop.run(loop.now_s + WATCHDOG_S + TICK_S + T)
    assert loop.bench.module.tripped
    assert loop.put_out_by_module() == 0.0


def test_a_nan_inside_a_program_never_becomes_a_voltage() -> None:
    loop = loop_in("approach", "loop")
    loop.runner("estimator").service = _without_numbers(ESTIMATOR)
    begun_s = loop.now_s
    loop.run(begun_s + 2.0 * REACTION_S)
    assert any(
        isinstance(one, Estimate) and one.arms[0].force_mN != one.arms[0].force_mN
        for _, one in loop.told or []
    )
    assert loop.newest.state in (*TRIPPED, "latched")
    assert all(isfinite(put_V) for _, put_V in loop.put_out)


def _without_numbers(service: AnyService) -> AnyService:
    """Return the service with a force of NaN."""

    def step(*given: Any) -> Any:
        state, outputs = service.step(*given)
        return state, tuple(with_arm(one, force_mN=nan) for one in outputs)

    return replace(service, step=step)
