"""The actuator keeps within the voltages of the plan, from the arming to the next one."""

import pytest
from msgspec.structs import replace

from pincette.control.safety.voltage import VOLTAGE_MAX, VOLTAGE_MIN, within
from pincette.control.voltage_range import VoltageRange, around
from pincette.core.messages import Arm, Reset
from pincette.core.messages.arms import ArmCommand
from pincette_actuator.requests import handle
from pincette_actuator.state import State
from pincette_actuator.step import start

from . import test_two_arms as two
from .bench import ARM, CONFIG, EPOCH, OWNER, command, play, position, with_voltages

PLANNED = VoltageRange(-0.2, 2.5)


def armed(*planned: VoltageRange, present_V: float = 0.0) -> State:
    state, _, _ = handle(CONFIG, start(CONFIG), Reset(acknowledge=True), 0.0)
    state = with_voltages(state, present_V)
    return handle(CONFIG, state, Arm(EPOCH, OWNER, "", voltages=planned), 0.0)[0]


def asked(state: State, *voltages_V: float) -> list[tuple[float, int]]:
    """Return the output voltages, and the limits that acted, for one command per period."""
    found: list[tuple[float, int]] = []
    for seq, voltage_V in enumerate(voltages_V):
        now = 0.02 * seq
        state, _ = play(state, (position(seq), now), (command(seq, voltage_V), now + 0.004))
        found.append(
            (state.arms[0].voltage_V, state.arms[0].limits_active & (VOLTAGE_MAX | VOLTAGE_MIN))
        )
    return found


def test_no_command_exceeds_the_range_of_the_plan() -> None:
    assert asked(armed(PLANNED), 1.5, 3.9, 1.0, -0.9) == [
        (1.5, 0),
        (2.5, VOLTAGE_MAX),
        (1.0, 0),
        (-0.2, VOLTAGE_MIN),
    ]


def test_without_a_plan_the_limits_of_the_rig_apply() -> None:
    assert asked(armed(), 2.0, 3.9) == [(2.0, 0), (3.9, 0)]


def test_a_planned_range_does_not_widen_the_limits_of_the_rig() -> None:
    assert asked(armed(VoltageRange(-9.0, 9.0)), 2.0, 3.9, 5.0)[-1] == (4.0, VOLTAGE_MAX)


def test_an_output_outside_the_planned_range_may_only_move_towards_it() -> None:
    """An earlier job has left the output at 3.5 V; the arming causes no jump."""
    state = armed(PLANNED, present_V=3.5)
    assert state.arms[0].voltage_V == 3.5
    assert asked(state, 3.8, 3.5, 3.0, 3.2) == [
        (3.5, VOLTAGE_MAX),
        (3.5, 0),
        (3.0, 0),
        (3.0, VOLTAGE_MAX),
    ]


def test_the_next_arming_sets_its_own_range() -> None:
    state = armed(PLANNED)
    after, _, _ = handle(CONFIG, replace(state, mode="idle"), Arm(EPOCH, OWNER, ""), 0.0)
    assert after.arms[0].planned is None


def test_each_arm_of_two_has_its_own_range() -> None:
    state, _, _ = handle(two.BOTH, start(two.BOTH), Reset(acknowledge=True), 0.0)
    request = Arm(EPOCH, OWNER, "", voltages=(PLANNED, VoltageRange(0.0, 0.7)))
    state, _, _ = handle(two.BOTH, state, request, 0.0)
    sent = two.command(0, 1.5, ArmCommand(1.5))
    state, _ = two.play(state, (two.position(0), 0.0), (sent, 0.004))
    assert [arm.voltage_V for arm in state.arms] == [1.5, 0.7]
    assert state.arms[1].limits_active & VOLTAGE_MAX


@pytest.mark.parametrize(
    ("present_V", "low_V", "high_V"), [(1.0, -0.2, 2.5), (3.0, -0.2, 3.0), (-0.5, -0.5, 2.5)]
)
def test_limits_are_narrowed_to_the_plan(present_V: float, low_V: float, high_V: float) -> None:
    narrowed = within(ARM.voltage, PLANNED, present_V)
    assert (narrowed.min_V, narrowed.max_V) == (low_V, high_V)
    assert narrowed.slew_V == ARM.voltage.slew_V
    assert within(ARM.voltage, None, present_V) is ARM.voltage


def test_a_planned_range_includes_the_voltages_of_the_plan_rest_and_a_margin() -> None:
    found = around([1.0, 3.0], 0.1, 0.2)
    assert (found.min_V, found.max_V) == pytest.approx((-0.5, 3.5))
    with pytest.raises(ValueError, match="must not be empty"):
        VoltageRange(1.0, 0.5)
