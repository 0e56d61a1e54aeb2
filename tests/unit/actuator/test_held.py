"""A part that is held through a trip, a reset and the next arming; and one that is released."""

import pytest

from pincette.control.record import replace
from pincette.core.faults import Cause, Fault, FaultCode, fault
from pincette.core.messages import Applied, Arm, Reset, Trip
from pincette.core.service import RefusedError, SetVoltage
from pincette_actuator.requests import handle
from pincette_actuator.state import State
from pincette_actuator.step import Inputs, initialize_from_output, step

from .bench import CONFIG, OWNER, WAKE, command, holding, play, position

LOCKSTEP = replace(CONFIG, lockstep=True)


def frozen(voltage_V: float = 1.0) -> State:
    state, _, _ = handle(CONFIG, holding(voltage_V, held=True), Trip(Cause.ESTOP), 0.01)
    assert state.mode == "frozen"
    return state


def waking(state: State, since_s: float, until_s: float) -> State:
    """Let time pass in the steps in which the actuator checks its clock."""
    for tick in range(1, round((until_s - since_s) / CONFIG.age.wake_s) + 1):
        state, _ = step(CONFIG, state, WAKE, since_s + tick * CONFIG.age.wake_s)
    return state


def rearmed(state: State, now: float = 0.2) -> State:
    state, _, outputs = handle(CONFIG, state, Arm(12, OWNER, ""), now)
    (applied,) = outputs
    assert isinstance(applied, Applied)
    assert (applied.part_held, applied.arms[0].voltage_V) == (True, 1.0)
    return state


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_reset_while_frozen_keeps_part_and_voltage(lockstep: bool) -> None:
    config = LOCKSTEP if lockstep else CONFIG
    state, _, outputs = handle(config, frozen(), Reset(acknowledge=True), 0.1)
    assert (state.mode, state.arms[0].voltage_V, state.part_held) == ("idle", 1.0, True)
    (applied,) = outputs
    assert isinstance(applied, Applied)
    assert (applied.state, applied.part_held, applied.final) == ("idle", True, True)


def test_an_output_that_fails_in_a_freeze_is_reported_once_in_addition_to_the_cause() -> None:
    off = fault(FaultCode.INSTRUMENT_SILENT, "no answer")
    state, outputs = play(frozen(), (Inputs(off, None, None), 0.02))
    reported = (fault(FaultCode.OUTPUT_UNCONFIRMED, "no answer"),)
    assert (state.mode, state.cause, state.faults) == ("frozen", "estop", reported)
    (applied,) = [one for one in outputs if isinstance(one, Applied)]
    assert (applied.state, applied.faults) == ("frozen", reported)
    state, _ = play(state, (Inputs(off, None, None), 0.04))
    assert state.faults == reported


@pytest.mark.parametrize(("found_V", "held"), [(1.0, True), (0.97, True), (0.0, False)])
def test_a_part_released_by_the_output_is_not_held_after_the_reset(
    found_V: float, held: bool
) -> None:
    state, _, _ = handle(CONFIG, frozen(), Reset(acknowledge=True), 0.1)
    state = initialize_from_output(CONFIG, state, (found_V,))
    assert (state.arms[0].voltage_V, state.part_held) == (found_V, held)


def test_after_a_reset_the_part_is_kept_beyond_the_time_of_a_freeze() -> None:
    state, _, _ = handle(CONFIG, frozen(), Reset(acknowledge=True), 0.1)
    state = waking(state, 0.1, 5.0)
    assert (state.mode, state.arms[0].voltage_V, state.part_held) == ("idle", 1.0, True)


def test_without_a_reset_a_freeze_ends_in_its_ramp() -> None:
    state = waking(frozen(), 0.01, 0.6)
    assert (state.mode, state.arms[0].voltage_V, state.part_held) == ("latched", 0.0, False)


def test_a_reset_while_ramping_is_refused() -> None:
    state, _, _ = handle(CONFIG, holding(held=False), Trip(Cause.ESTOP), 0.01)
    with pytest.raises(RefusedError, match="ramping"):
        handle(CONFIG, state, Reset(acknowledge=True), 0.02)


@pytest.mark.parametrize("when", ["before the first command", "while idle"])
def test_a_fault_after_the_reset_still_freezes(when: str) -> None:
    state, _, _ = handle(CONFIG, frozen(), Reset(acknowledge=True), 0.1)
    if when == "before the first command":
        state = rearmed(state)
    state, _, _ = handle(CONFIG, state, Trip(Cause.SUPERVISOR), 0.3)
    assert (state.mode, state.cause, state.arms[0].voltage_V) == ("frozen", "supervisor", 1.0)


def test_a_missing_first_command_after_the_arming_freezes_too() -> None:
    state, _, _ = handle(CONFIG, frozen(), Reset(acknowledge=True), 0.1)
    state = waking(rearmed(state), 0.2, 1.6)
    assert state.mode == "frozen"
    assert "command_age" in state.cause


def test_the_first_command_states_whether_the_part_is_still_held() -> None:
    state, _, _ = handle(CONFIG, frozen(), Reset(acknowledge=True), 0.1)
    state, _ = play(
        rearmed(state), (position(0, epoch=12), 0.2), (command(0, held=False, epoch=12), 0.204)
    )
    assert not state.part_held
    state, _, _ = handle(CONFIG, state, Trip(Cause.ESTOP), 0.21)
    assert state.mode == "ramping"


def test_a_release_ramps_with_a_part_and_ends_a_freeze() -> None:
    state, _, _ = handle(CONFIG, holding(held=True), Trip(Cause.ABORT, release_now=True), 0.01)
    assert state.mode == "ramping"
    state, _, _ = handle(
        CONFIG, waking(frozen(), 0.01, 0.2), Trip(Cause.ABORT, release_now=True), 0.2
    )
    assert (state.mode, state.cause) == ("ramping", "estop")
    state = waking(state, 0.2, 0.3)
    assert (state.mode, state.arms[0].voltage_V, state.part_held) == ("latched", 0.0, False)


def test_a_release_request_after_a_freeze_has_been_latched_changes_nothing() -> None:
    state = waking(frozen(), 0.01, 0.6)
    after, _, _ = handle(CONFIG, state, Trip(Cause.ABORT, release_now=True), 0.7)
    assert after == state


@pytest.mark.parametrize(
    ("words", "faults"), [("smoke", (fault(FaultCode.REQUESTED, "smoke"),)), ("", ())]
)
def test_a_trip_states_the_reason_of_the_requester(words: str, faults: tuple[Fault, ...]) -> None:
    state, _, _ = handle(CONFIG, holding(held=True), Trip(Cause.ESTOP, words=words), 0.01)
    assert state.faults == faults


def test_in_lockstep_a_trip_without_ticks_keeps_or_releases_a_part_immediately() -> None:
    state, _, _ = handle(LOCKSTEP, frozen(), Reset(acknowledge=True), 0.1)
    kept, _, outputs = handle(LOCKSTEP, state, Trip(Cause.ESTOP), 0.1)
    assert (kept.mode, kept.arms[0].voltage_V, kept.part_held) == ("latched", 1.0, True)
    assert not any(isinstance(output, SetVoltage) for output in outputs)
    again, _, _ = handle(LOCKSTEP, kept, Reset(acknowledge=True), 0.1)
    assert (again.mode, again.arms[0].voltage_V, again.part_held) == ("idle", 1.0, True)
    free, _, outputs = handle(LOCKSTEP, state, Trip(Cause.ABORT, release_now=True), 0.1)
    assert (free.mode, free.arms[0].voltage_V, free.part_held) == ("latched", 0.0, False)
    assert outputs[0] == SetVoltage((0.0,))


def test_in_lockstep_the_reset_ends_a_ramp_that_no_tick_will_end() -> None:
    state, _, _ = handle(LOCKSTEP, holding(held=False), Trip(Cause.ESTOP), 0.004)
    assert state.mode == "ramping"
    state, _, outputs = handle(LOCKSTEP, state, Reset(acknowledge=True), 0.004)
    assert (state.mode, state.arms[0].voltage_V) == ("idle", 0.0)
    assert outputs[0] == SetVoltage((0.0,))


def test_a_part_held_at_the_final_command_is_kept_afterwards() -> None:
    given = command(1, held=True)
    assert given.command is not None
    final = replace(given, command=replace(given.command, final=True))
    state, _ = play(holding(held=True), (position(1), 0.02), (final, 0.024))
    state = waking(state, 0.024, 2.0)
    assert (state.mode, state.part_held, state.arms[0].voltage_V) == ("idle", True, 1.0)
