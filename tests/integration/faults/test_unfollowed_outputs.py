"""A force is within its stated uncertainty after the output was moved without the estimator's
knowledge.

The estimator continues meanwhile, and its knowledge of the arm's history is no longer right. The
arm is new when the loop starts and its model fits it, so at first its history is fully known.
"""

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from pincette.core.faults import FaultCode
from pincette.core.messages import Estimate
from tests.support.scripted import PROGRAM
from tests.support.virtual_loop import VirtualLoop
from tests.support.virtual_loop_bench import scripted
from tests.support.virtual_loop_places import EPOCH, FREEZE_S, T, begun, reach, view_of

AWAY_S = 2.0
ELSEWHERE_V = -0.8
"""Voltage to which another program has set the output meanwhile."""
LATE_TICKS = 25
"""Late ticks of the hold, at which the force has settled."""


def a_known_arm() -> VirtualLoop:
    """Return a loop in the hold of its second grip, with a known history of the arm."""
    loop = begun()
    ends(loop)
    task = loop.runner("estimator")
    (arm,) = task.state.arms
    known = replace(arm, unknown=replace(arm.unknown, known=True))
    task.state = replace(task.state, arms=(known,))
    loop.arm(PROGRAM, EPOCH + 1)
    return loop


def ends(loop: VirtualLoop) -> None:
    assert loop.run(loop.now_s + 10.0, lambda: loop.newest.final), loop.newest


def held(loop: VirtualLoop) -> list[tuple[float, float]]:
    """Play a grip; returns error and uncertainty of the force for each late tick of its hold."""
    reach(loop, "hold", LATE_TICKS)
    found: list[tuple[float, float]] = []
    while (view := view_of(loop)) is not None and view.phase == "hold":
        reported = next(one for _, one in reversed(loop.told or []) if isinstance(one, Estimate))
        assert reported.arms[0].zero_age_s is not None, reported.arms[0].zero_refusal
        error_mN = reported.arms[0].force_mN - loop.bench.rig.snapshot().force_mN
        found.append((error_mN, reported.arms[0].force_uncertainty_mN))
        loop.run(loop.now_s + T)
    return found


def elsewhere(loop: VirtualLoop, *voltages_V: float) -> None:
    """Move the output by something else: its supply, or a hand."""
    for voltage_V in voltages_V:
        loop.run(loop.now_s + 0.4 * AWAY_S)
        loop.bench.put_V(voltage_V)
    loop.bench.module.power_cycle()


def without_supply(loop: VirtualLoop) -> None:
    loop.bench.order(scripted("output", "off", for_s=AWAY_S))
    loop.bench.put_V(0.0)
    elsewhere(loop)


def without_cable(loop: VirtualLoop) -> None:
    loop.bench.order(scripted("output", "off", for_s=AWAY_S))
    elsewhere(loop, ELSEWHERE_V, 0.0)


def without_actuator(loop: VirtualLoop) -> None:
    loop.kill("actuator")
    elsewhere(loop, ELSEWHERE_V, 0.0)
    loop.restart("actuator")


GONE: tuple[Callable[[VirtualLoop], None], ...] = (without_supply, without_cable, without_actuator)


def begin_again(loop: VirtualLoop) -> None:
    """Reset the rig and begin a grip."""
    loop.run(loop.now_s + AWAY_S + FREEZE_S)
    assert loop.runner("actuator").state.mode == "latched"
    loop.reset()
    loop.arm(PROGRAM, EPOCH + 2)


def doubts(loop: VirtualLoop) -> set[FaultCode]:
    return {finding.code for finding in loop.runner("estimator").state.findings}


@pytest.mark.parametrize("gone", GONE, ids=lambda gone: gone.__name__)
def test_after_the_fault_the_next_force_is_within_its_stated_uncertainty(
    gone: Callable[[VirtualLoop], None],
) -> None:
    loop = a_known_arm()
    reach(loop, "hold", 16)
    gone(loop)
    begin_again(loop)
    assert doubts(loop) == {FaultCode.MEMORY_UNKNOWN}
    found = held(loop)
    assert len(found) > LATE_TICKS - 10
    for error_mN, u_mN in found:
        assert abs(error_mN) <= u_mN


def test_if_an_idle_output_was_moved_the_history_of_the_arm_is_unknown() -> None:
    """No program has written meanwhile; the arming finds the output at another voltage."""
    loop = a_known_arm()
    ends(loop)
    loop.run(loop.now_s + 0.5)
    assert doubts(loop) == set()
    loop.bench.module.power_cycle()
    loop.arm(PROGRAM, EPOCH + 2)
    loop.run(loop.now_s + 3.0 * T)
    assert doubts(loop) == {FaultCode.MEMORY_UNKNOWN}


def test_after_a_trip_that_did_not_move_the_output_the_history_of_the_arm_is_known() -> None:
    loop = a_known_arm()
    reach(loop, "hold", 16)
    loop.stop("controller", AWAY_S)
    begin_again(loop)
    assert doubts(loop) == set()
    for error_mN, u_mN in held(loop):
        assert abs(error_mN) <= u_mN
