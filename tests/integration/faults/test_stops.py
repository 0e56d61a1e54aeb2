"""Rows 10, 22, 24, 25 and 26: stops and restarts, with the arm free and with a part held."""

from itertools import pairwise

import pytest

from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive
from pincette.core.faults import Cause
from pincette.core.messages import Arm, Load, Reset, Trip
from tests.support.reactions import RAMP_S
from tests.support.scripted import PROGRAM
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_places import EPOCH, FREEZE_S, STATES, T, place

MOVING = tuple(state for state in STATES if state != "idle")
BUS_S = 0.003
PLACES_IN_THE_PERIOD = (0.03, 0.2, 0.45, 0.7, 0.96)
WATCHDOG_S, TICK_S = 0.5, 0.05
HOLD = Program(
    segments=(Drive("hold", 0.4),),
    guards=PROGRAM.guards,
    contact_stiffness_mN_per_um=PROGRAM.contact_stiffness_mN_per_um,
    begins_held=True,
)


def states_since(loop: VirtualLoop, since_s: float) -> set[str]:
    """Return the states of the actuator since then."""
    return {echo.state for at_s, echo in loop.applied if at_s > since_s}


@pytest.mark.parametrize("let_go", [False, True], ids=["keep", "let go"])
@pytest.mark.parametrize("state", MOVING)
def test_an_emergency_stop_acts_within_a_period_in_every_state(state: str, let_go: bool) -> None:
    for phase in PLACES_IN_THE_PERIOD:
        loop = place(state).loop.fork(round(100 * phase))
        loop.run(loop.now_s + phase * T)
        held = loop.runner("actuator").state.part_held
        asked_s, put_out = loop.now_s, len(loop.put_out)
        loop.must("actuator", Trip(Cause.ESTOP, release_now=let_go))
        loop.run(asked_s + T + BUS_S)
        frozen = held and not let_go
        assert loop.newest.state == ("frozen" if frozen else "ramping")
        if not frozen:
            assert len(loop.put_out) > put_out, "the ramp has begun"
        loop.run(asked_s + T + RAMP_S + (FREEZE_S if frozen else 0.0) + T)
        assert (loop.newest.state, loop.newest.cause) == ("latched", "estop")
        assert loop.put_out[-1][1] == loop.rig.safety.safe_V
        loop.run(loop.now_s + 0.3)
        assert states_since(loop, loop.now_s - 0.2) == {"latched"}


def test_an_emergency_stop_of_an_idle_rig_latches_it_without_a_jump() -> None:
    loop = place("idle").loop.fork(1)
    loop.must("actuator", Trip(Cause.ESTOP))
    loop.run(loop.now_s + 4.0 * T)
    assert loop.newest.state == "latched"
    assert {put_V for _, put_V in loop.put_out} <= {0.0}
    reply = loop.call("actuator", Arm(EPOCH, 1, loop.rig.digest()))
    assert isinstance(reply, str)
    assert "reset it first" in reply


@pytest.mark.parametrize("state", MOVING)
def test_after_a_trip_nothing_moves_until_a_person_has_reset_it(state: str) -> None:
    """The controller returns and sends commands; samples and requests arrive: none of them has
    an effect."""
    loop = place(state).loop.fork(2)
    loop.stop("controller", 0.09)
    loop.run(loop.now_s + FREEZE_S + 0.3)
    assert loop.newest.state == "latched"
    latched_s = loop.now_s
    loop.restart("controller")
    loop.must("controller", Load(PROGRAM))
    owner = loop.runner("controller").instance
    loop.must("controller", Arm(EPOCH, owner, loop.rig.digest()))
    for question in (Arm(EPOCH + 1, owner, loop.rig.digest()), Reset(acknowledge=False)):
        assert isinstance(loop.call("actuator", question), str)
    loop.run(latched_s + 1.0)
    assert states_since(loop, latched_s) == {"latched"}
    assert {put_V for at_s, put_V in loop.put_out if at_s > latched_s} <= {0.0}
    loop.reset()
    loop.run(loop.now_s + 0.2)
    assert {put_V for at_s, put_V in loop.put_out if at_s > latched_s} <= {0.0}
    loop.arm(PROGRAM, EPOCH + 2)
    loop.run(loop.now_s + 0.4)
    assert loop.newest.state == "armed"
    assert loop.newest.answered


@pytest.mark.parametrize("state", ["load", "hold", "paused"])
def test_a_frozen_part_can_be_held_further_from_its_present_voltage(state: str) -> None:
    loop = place(state).loop.fork(3)
    loop.kill("controller")
    loop.run(loop.now_s + 0.08)
    frozen = loop.newest
    assert (frozen.state, frozen.part_held) == ("frozen", True)
    loop.restart("controller")
    loop.reset()
    kept = len(loop.put_out)
    loop.arm(HOLD, EPOCH + 1)
    loop.run(loop.now_s + 0.25)
    assert (loop.newest.state, loop.newest.part_held) == ("armed", True)
    voltages_V = [frozen.arms[0].voltage_V, *(put_V for _, put_V in loop.put_out[kept:])]
    steps_V = [abs(after - before) for before, after in pairwise(voltages_V)]
    assert max(steps_V) <= loop.rig.limits.slew_V_per_s * T + 0.001
    assert abs(voltages_V[1] - voltages_V[0]) < 0.05, "the arming must not cause a jump"


@pytest.mark.parametrize("state", ["approach", "hold"])
def test_if_the_actuator_dies_the_output_module_becomes_safe_by_its_watchdog(state: str) -> None:
    loop = place(state).loop.fork(4)
    loop.kill("actuator")
    killed_s = loop.now_s
    loop.run(killed_s + WATCHDOG_S + TICK_S + T)
    assert loop.bench.module.tripped
    assert loop.put_out_by_module() == 0.0
    loop.restart("actuator")
    loop.run(loop.now_s + 0.5)
    booted = loop.runner("actuator").state
    assert (booted.mode, booted.cause) == ("latched", "restart")
    reply = loop.call("actuator", Arm(EPOCH + 1, 1, loop.rig.digest()))
    assert isinstance(reply, str)


def test_an_actuator_that_hangs_briefly_does_not_trip_its_module() -> None:
    loop = place("approach").loop.fork(4)
    loop.stop("actuator", 0.15)
    loop.run(loop.now_s + 1.0)
    assert not loop.bench.module.tripped


def test_a_restarted_actuator_waits_for_a_person_and_takes_over_the_voltage() -> None:
    """The restart is faster than the watchdog: the arm stays where it was, and nothing resumes."""
    loop = place("approach").loop.fork(5)
    loop.run(loop.now_s + 0.5 * T)
    stood_V = loop.put_out[-1][1]
    loop.kill("actuator")
    loop.run(loop.now_s + 2.0 * T)
    loop.restart("actuator")
    loop.run(loop.now_s + 0.3)
    state = loop.runner("actuator").state
    assert (state.mode, state.cause) == ("latched", "restart")
    assert abs(state.arms[0].voltage_V - stood_V) <= 0.001
    assert loop.put_out[-1][1] == stood_V
    loop.reset()
    loop.run(loop.now_s + 0.2)
    assert loop.put_out[-1][1] == stood_V, "a reset moves nothing"


def test_programs_with_other_rig_files_are_not_armed_and_report_it() -> None:
    loop = place("idle").loop.fork(6)
    for name in ("actuator", "estimator", "sensor"):
        reply = loop.call(name, Arm(EPOCH, 1, "0000"))
        assert isinstance(reply, str)
        assert loop.rig.digest() in reply
        assert "0000" in reply
        assert name in reply
    loop.run(loop.now_s + 0.1)
    assert loop.newest.state == "idle"
