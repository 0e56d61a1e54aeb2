"""Content of an echo and the tick it belongs to, with and without a failed output."""

from dataclasses import replace as changed

import pytest
from msgspec.structs import replace

from pincette.core.faults import Mode
from pincette.core.messages import Applied, Command
from pincette.core.messages.arms import ArmCommand
from pincette.core.service import PutOut, ReadBack, SetVoltage, Slept
from pincette_actuator.state import applied_of
from pincette_actuator.step import Inputs, initialize_from_output

from .bench import (
    CONFIG,
    EPOCH,
    OFF,
    OWNER,
    WAKE,
    T,
    armed,
    holding,
    play,
    position,
    wakes,
    with_voltages,
)

FAILED = Inputs(OFF, None, None)
COMMAND = Command(
    EPOCH, 0, OWNER, (ArmCommand(1.0),), False, False, False, True, segment=3, segment_tick=7
)
UNASKED = Inputs(
    None, Command(EPOCH, 1, OWNER, (ArmCommand(1.0),), True, False, False, False), None
)


def echoes(outputs: list[object]) -> list[Applied]:
    return [one for one in outputs if isinstance(one, Applied)]


def test_segment_tick_and_slew_are_those_of_the_command() -> None:
    state, outputs = play(armed(), (position(0), 0.0), (Inputs(None, COMMAND, None), 0.004))
    echo = echoes([*outputs])[-1]
    assert (echo.segment, echo.segment_tick, echo.slewing_s) == (3, 7, T)
    without = applied_of(state, 0)
    assert (without.segment, without.segment_tick, without.slewing_s) == (None, 0, None)


def test_a_tick_is_answered_once_while_the_output_is_read_back() -> None:
    state, _ = play(holding(held=True), (FAILED, 0.01), (position(1), 0.02))
    state, outputs = play(state, (WAKE, 0.02 + 0.8 * T))
    assert [one.seq for one in echoes([*outputs])] == [1]
    assert (state.answered_seq, state.asked_s) == (1, 0.02 + 0.8 * T)
    state, _ = play(state, (position(2), 0.04), (FAILED, 0.041))
    assert state.asked_s == 0.02 + 0.8 * T, "the time must not change without a request"


def test_a_commanded_output_has_not_yet_reported_its_voltage() -> None:
    state, _ = play(
        holding(held=False), (FAILED, 0.01), (Inputs(PutOut((0.9,)), None, None), 0.011)
    )
    assert (state.mode, state.located) == (Mode.RAMPING, True)
    state, outputs = play(state, (WAKE, 0.012))
    assert isinstance(outputs[0], SetVoltage)
    assert state.located is False


def test_a_reported_voltage_belongs_to_the_newest_tick() -> None:
    _, outputs = play(
        holding(held=True), (FAILED, 0.01), (Inputs(PutOut((0.9,)), None, None), 0.011)
    )
    assert [one.seq for one in echoes([*outputs])] == [0, 0]


def test_a_suspension_is_reported_from_the_time_at_which_it_is_noticed() -> None:
    state, _ = play(holding(held=True), (Inputs(Slept(3600.0), None, None), 0.01))
    assert state.since_s == 0.01


def test_a_controller_without_requests_causes_a_read_back() -> None:
    state, _ = play(holding(held=True), (FAILED, 0.01), (position(1), 0.02))
    _, outputs = play(replace(state, asked_s=0.0), (UNASKED, 0.022))
    assert isinstance(outputs[0], ReadBack)


def test_the_end_of_a_freeze_causes_a_read_back() -> None:
    state, _ = play(holding(held=True), (FAILED, 0.01))
    state, _ = play(state, *wakes(0.015, 0.505))
    state, outputs = play(replace(state, asked_s=0.0), (WAKE, 0.5105))
    assert state.mode == Mode.RAMPING
    assert isinstance(outputs[0], ReadBack)


def test_an_uncertainty_is_reported_only_with_the_cause_of_a_freeze() -> None:
    state, _ = play(holding(held=False), *wakes(0.005, 0.06))
    assert (state.mode, state.cause) == (Mode.RAMPING, "command_age")
    after, _ = play(state, (FAILED, 0.061))
    assert after.faults == state.faults


@pytest.mark.parametrize(("found_V", "held"), [(1.4, False), (1.5, True), (1.9, True)])
def test_after_a_restart_a_part_counts_as_released_near_the_safe_voltage(
    found_V: float, held: bool
) -> None:
    kept = with_voltages(holding(held=True), 2.0)
    state = initialize_from_output(changed(CONFIG, safe_V=1.0), kept, (found_V,))
    assert (state.arms[0].voltage_V, state.part_held) == (found_V, held)
