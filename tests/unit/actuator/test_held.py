"""A part that is held through a trip, a reset and the next arming; and one that is let go."""

from dataclasses import replace

import pytest

from pincette.messages import Applied, Arm, Reset, Trip
from pincette.service import Drive, RefusedError
from pincette_actuator.answering import answer
from pincette_actuator.state import State
from pincette_actuator.step import step

from .bench import CONFIG, OWNER, WAKE, command, holding, play, position

LOCKSTEP = replace(CONFIG, lockstep=True)


def frozen(voltage_V: float = 1.0) -> State:
    state, _, _ = answer(CONFIG, holding(voltage_V, held=True), Trip("estop"), 0.01)
    assert state.mode == "frozen"
    return state


def waking(state: State, since_s: float, until_s: float) -> State:
    """As often as the actuator looks at its clock."""
    for tick in range(1, round((until_s - since_s) / CONFIG.age.wake_s) + 1):
        state, _ = step(CONFIG, state, WAKE, since_s + tick * CONFIG.age.wake_s)
    return state


def rearmed(state: State, now: float = 0.2) -> State:
    state, _, outputs = answer(CONFIG, state, Arm(12, OWNER, ""), now)
    (applied,) = outputs
    assert isinstance(applied, Applied)
    assert (applied.part_held, applied.voltage_V) == (True, 1.0)
    return state


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_reset_while_frozen_keeps_part_and_voltage(lockstep: bool) -> None:
    config = LOCKSTEP if lockstep else CONFIG
    state, _, outputs = answer(config, frozen(), Reset(acknowledge=True), 0.1)
    assert (state.mode, state.voltage_V, state.part_held) == ("idle", 1.0, True)
    (applied,) = outputs
    assert isinstance(applied, Applied)
    assert (applied.state, applied.part_held, applied.final) == ("idle", True, True)


def test_what_was_reset_is_kept_beyond_the_time_of_a_freeze() -> None:
    state, _, _ = answer(CONFIG, frozen(), Reset(acknowledge=True), 0.1)
    state = waking(state, 0.1, 5.0)
    assert (state.mode, state.voltage_V, state.part_held) == ("idle", 1.0, True)


def test_without_a_reset_a_freeze_ends_in_its_ramp() -> None:
    state = waking(frozen(), 0.01, 0.6)
    assert (state.mode, state.voltage_V, state.part_held) == ("latched", 0.0, False)


def test_a_reset_while_ramping_is_refused() -> None:
    state, _, _ = answer(CONFIG, holding(held=False), Trip("estop"), 0.01)
    with pytest.raises(RefusedError, match="ramping"):
        answer(CONFIG, state, Reset(acknowledge=True), 0.02)


@pytest.mark.parametrize("cause", ["before the first command", "while idle"])
def test_a_fault_after_the_reset_still_freezes(cause: str) -> None:
    state, _, _ = answer(CONFIG, frozen(), Reset(acknowledge=True), 0.1)
    if cause == "before the first command":
        state = rearmed(state)
    state, _, _ = answer(CONFIG, state, Trip(cause), 0.3)
    assert (state.mode, state.cause, state.voltage_V) == ("frozen", cause, 1.0)


def test_no_command_in_time_after_the_arming_freezes_too() -> None:
    state, _, _ = answer(CONFIG, frozen(), Reset(acknowledge=True), 0.1)
    state = waking(rearmed(state), 0.2, 1.6)
    assert state.mode == "frozen"
    assert "command_age" in state.cause


def test_the_first_command_says_whether_the_part_is_still_held() -> None:
    state, _, _ = answer(CONFIG, frozen(), Reset(acknowledge=True), 0.1)
    state, _ = play(
        rearmed(state), (position(0, epoch=12), 0.2), (command(0, held=False, epoch=12), 0.204)
    )
    assert not state.part_held
    state, _, _ = answer(CONFIG, state, Trip("estop"), 0.21)
    assert state.mode == "ramping"


def test_let_go_ramps_with_a_part_and_out_of_a_freeze() -> None:
    state, _, _ = answer(CONFIG, holding(held=True), Trip("abort", let_go=True), 0.01)
    assert state.mode == "ramping"
    state, _, _ = answer(CONFIG, waking(frozen(), 0.01, 0.2), Trip("abort", let_go=True), 0.2)
    assert (state.mode, state.cause) == ("ramping", "estop")
    state = waking(state, 0.2, 0.3)
    assert (state.mode, state.voltage_V, state.part_held) == ("latched", 0.0, False)


def test_let_go_while_frozen_does_nothing_more_once_it_is_latched() -> None:
    state = waking(frozen(), 0.01, 0.6)
    after, _, _ = answer(CONFIG, state, Trip("abort", let_go=True), 0.7)
    assert after == state


def test_in_lockstep_an_idle_part_is_kept_or_let_go_at_once() -> None:
    state, _, _ = answer(LOCKSTEP, frozen(), Reset(acknowledge=True), 0.1)
    kept, _, outputs = answer(LOCKSTEP, state, Trip("estop"), 0.1)
    assert (kept.mode, kept.voltage_V, kept.part_held) == ("latched", 1.0, True)
    assert not any(isinstance(output, Drive) for output in outputs)
    again, _, _ = answer(LOCKSTEP, kept, Reset(acknowledge=True), 0.1)
    assert (again.mode, again.voltage_V, again.part_held) == ("idle", 1.0, True)
    free, _, outputs = answer(LOCKSTEP, state, Trip("abort", let_go=True), 0.1)
    assert (free.mode, free.voltage_V, free.part_held) == ("latched", 0.0, False)
    assert outputs[0] == Drive(0.0)


def test_in_lockstep_a_ramp_that_no_tick_will_end_is_ended_by_the_reset() -> None:
    state, _, _ = answer(LOCKSTEP, holding(held=False), Trip("estop"), 0.004)
    assert state.mode == "ramping"
    state, _, outputs = answer(LOCKSTEP, state, Reset(acknowledge=True), 0.004)
    assert (state.mode, state.voltage_V) == ("idle", 0.0)
    assert outputs[0] == Drive(0.0)


def test_a_part_handed_over_by_the_last_command_is_kept() -> None:
    given = command(1, held=True)
    assert given.command is not None
    final = given._replace(command=replace(given.command, final=True))
    state, _ = play(holding(held=True), (position(1), 0.02), (final, 0.024))
    state = waking(state, 0.024, 2.0)
    assert (state.mode, state.part_held, state.voltage_V) == ("idle", True, 1.0)
