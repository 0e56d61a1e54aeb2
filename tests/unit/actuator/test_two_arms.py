"""Two arms under one latch: a command is accepted or refused as a whole, and a trip of one arm
trips both."""

import dataclasses

import pytest
from msgspec.structs import replace

from pincette.control.safety.confirmation import (
    READ_BACK_V,
    differs,
    found,
    waits_for_read_back,
)
from pincette.control.safety.latch import at_safe, ramped, shutdown, trip
from pincette.control.safety.watchdog_feed import may_kick_watchdog
from pincette.core.faults import Cause, FaultCode, Mode, fault
from pincette.core.messages import Applied, Arm, Command, Position, Reset, Trip
from pincette.core.messages.arms import ArmCommand, ArmPosition
from pincette.core.service import PutOut, ReadBack, SetVoltage
from pincette.core.wording import applied_text, fault_text
from pincette_actuator.requests import handle
from pincette_actuator.state import State
from pincette_actuator.step import SERVICE, Inputs, initialize_from_output, start, step

from .bench import ARM, CONFIG, EPOCH, OWNER, WAKE, T, with_voltages

BOTH = dataclasses.replace(CONFIG, arms=(ARM, ARM))
FAILED = Inputs(fault(FaultCode.INSTRUMENT_SILENT, "no answer", arm=2), None, None)


def position(seq: int, x_um: float = 1.0, second: float | None = 2.0) -> Inputs:
    other = ArmPosition(0.0 if second is None else second, second is not None)
    first = ArmPosition(x_um, valid=True)
    return Inputs(None, None, Position(EPOCH, seq, seq * T, (first, other)))


def command(seq: int, first_V: float, *others: ArmCommand, held: bool = False) -> Inputs:
    arms = ArmCommand(first_V), *others
    return Inputs(None, Command(EPOCH, seq, OWNER, arms, held, False, False, True), None)


def play(state: State, *events: tuple[Inputs, float]) -> tuple[State, list[object]]:
    outputs: list[object] = []
    for inputs, now in events:
        state, made = step(BOTH, state, inputs, now)
        outputs += made
    return state, outputs


def armed() -> State:
    state, _, _ = handle(BOTH, start(BOTH), Reset(acknowledge=True), 0.0)
    state, _, _ = handle(BOTH, state, Arm(EPOCH, OWNER, ""), 0.0)
    return state


def at(first_V: float, second_V: float, *, held: bool = False) -> State:
    state, _ = play(
        armed(),
        (position(0), 0.0),
        (command(0, first_V, ArmCommand(second_V), held=held), 0.004),
    )
    assert (state.arms[0].voltage_V, state.arms[1].voltage_V) == (first_V, second_V)
    return state


def test_both_voltages_are_written_and_reported_together() -> None:
    _, outputs = play(armed(), (position(0), 0.0), (command(0, 1.0, ArmCommand(3.0)), T + 0.001))
    assert outputs[0] == SetVoltage((1.0, 2.0))
    applied = outputs[1]
    assert isinstance(applied, Applied)
    assert len(applied.arms) == 2
    assert (applied.arms[1].voltage_V, applied.arms[1].limits_active) == (2.0, 4)
    assert applied.arms[0].limits_active == 0


def test_a_resting_arm_does_not_change_the_slew_of_the_other() -> None:
    state = at(1.0, 1.0)
    state, _ = play(state, (position(1), T), (command(1, 1.0, ArmCommand(1.0)), T + 0.004))
    assert state.moved_s == 0.004
    state, _ = play(state, (position(2), 2 * T), (command(2, 1.0, ArmCommand(1.5)), 2 * T))
    assert state.moved_s == 2 * T
    state, _ = play(state, (position(3), 3 * T), (command(3, 1.5, ArmCommand(1.5)), 3 * T))
    assert state.moved_s == 3 * T


def test_the_second_arm_slews_by_elapsed_time_too() -> None:
    state, _ = play(at(1.0, 1.0), (position(1), T), (command(1, 1.0, ArmCommand(4.0)), T))
    assert state.arms[1].voltage_V == pytest.approx(1.0 + 2.0 * (T - 0.004) / T)


def test_commands_for_the_wrong_number_of_arms_are_refused() -> None:
    state, _ = play(armed(), (position(0), 0.0), (command(0, 1.0), 0.004))
    assert (state.arms[0].voltage_V, state.arms[1].voltage_V, state.refused) == (0.0, 0.0, 1)
    assert fault_text(state.refusal) == (
        "command 0: it is for 1 driven arms, the rig has 2: start all programs with the same rig "
        "file"
    )
    one, _, _ = handle(CONFIG, start(CONFIG), Reset(acknowledge=True), 0.0)
    one, _, _ = handle(CONFIG, one, Arm(EPOCH, OWNER, ""), 0.0)
    for inputs, now in ((position(0), 0.0), (command(0, 1.0, ArmCommand(1.0)), 0.004)):
        one, _ = step(CONFIG, one, inputs, now)
    assert (one.arms[0].voltage_V, one.refused) == (0.0, 1)
    assert "it is for 2 driven arms, the rig has 1" in fault_text(one.refusal)


def test_an_empty_command_may_omit_the_second_arm() -> None:
    blind = Command(EPOCH, 0, OWNER, (ArmCommand(0.0),), False, False, False, False)
    state, _ = play(armed(), (position(0), 0.0), (Inputs(None, blind, None), 0.004))
    assert state.refused == 0


def test_a_nan_of_the_second_arm_refuses_the_whole_command() -> None:
    for second, words in (
        (ArmCommand(1e6), "1e+06 V is impossible"),
        (ArmCommand(1.0, force_mN=float("nan")), "not a force"),
        (ArmCommand(1.0, x_d_um=float("inf")), "not a position"),
    ):
        state, _ = play(armed(), (position(0), 0.0), (command(0, 1.0, second), 0.004))
        assert (state.arms[0].voltage_V, state.refused) == (0.0, 1)
        assert fault_text(state.refusal).startswith("command 0: second arm: ")
        assert words in fault_text(state.refusal)


@pytest.mark.parametrize("held", [False, True])
def test_the_second_arm_beyond_its_position_limits_trips_both_arms(held: bool) -> None:
    state = at(1.0, 2.0, held=held)
    for seq in (1, 2, 3):
        state, _ = play(state, (position(seq, second=90.0), seq * T))
    assert (state.cause, state.mode) == (Cause.POSITION, Mode.FROZEN if held else Mode.RAMPING)
    assert fault_text(state.faults[0]).startswith("second arm: 90.00 µm")
    state, _ = play(state, *[(WAKE, 3 * T + 0.005 * k) for k in range(200)])
    assert (state.mode, state.arms[0].voltage_V, state.arms[1].voltage_V) == ("latched", 0.0, 0.0)


def test_an_invalid_sample_of_either_arm_causes_no_trip() -> None:
    state = at(1.0, 2.0)
    state, _ = play(state, (position(1, second=None), T), (position(2, second=90.0), 2 * T))
    assert state.arms[1].watches.position.count == 1
    invalid = Position(
        EPOCH, 3, 3 * T, (ArmPosition(0.0, valid=False, fault=None), ArmPosition(1.0, True))
    )
    state, _ = play(state, (Inputs(None, None, invalid), 3 * T))
    assert state.arrivals[-1].x_um == (None, 1.0)
    assert state.arms[1].watches.position.count == 0


def feed(state: State, seqs: range, force_mN: float, x_d_um: float, *, held: bool) -> State:
    for seq in seqs:
        second = ArmCommand(2.0, force_mN, x_d_um)
        state, _ = play(
            state, (position(seq), seq * T), (command(seq, 1.0, second, held=held), seq * T + 0.004)
        )
    return state


def test_too_much_force_at_the_second_arm_opens_both_even_with_a_part() -> None:
    state = feed(at(1.0, 2.0, held=True), range(1, 4), 60.0, 2.0, held=True)
    assert (state.cause, state.mode) == (Cause.FORCE, Mode.RAMPING)
    assert fault_text(state.faults[0]).startswith("second arm: 60.0 mN, limit 50.0 mN")


def test_the_second_arm_far_from_its_target_trips_both_arms() -> None:
    state = feed(at(1.0, 2.0), range(1, 7), 1.0, 40.0, held=False)
    assert (state.cause, state.mode) == (Cause.FOLLOWING_ERROR, Mode.RAMPING)


def test_a_freeze_ends_if_the_second_arm_is_pressed_too_hard() -> None:
    state = at(1.0, 2.0, held=True)
    state, _, _ = handle(BOTH, state, Trip(Cause.ESTOP), 0.01)
    assert state.mode == Mode.FROZEN
    state = feed(state, range(1, 3), 60.0, 2.0, held=True)
    assert state.mode == Mode.FROZEN
    state = feed(state, range(3, 4), 60.0, 2.0, held=True)
    assert state.mode == Mode.RAMPING
    assert "second arm: released: 60.0 mN" in fault_text(state.faults[-1])


def test_a_freeze_that_ends_with_a_silent_output_reports_no_force() -> None:
    state = at(1.0, 2.0, held=True)
    state, _, _ = handle(BOTH, state, Trip(Cause.ESTOP), 0.01)
    state = feed(replace(state, unconfirmed=True), range(1, 4), 60.0, 2.0, held=True)
    assert state.mode == Mode.RAMPING
    (released,) = [one for one in state.faults if one.code is FaultCode.FREEZE_RELEASED]
    assert released.number("force_mN") is None
    assert "60" not in fault_text(released)
    assert "unknown" in fault_text(released)


def test_a_freeze_is_ended_only_once_if_both_arms_exceed_the_force_limit() -> None:
    state = at(1.0, 2.0, held=True)
    state, _, _ = handle(BOTH, state, Trip(Cause.ESTOP), 0.01)
    for seq in (1, 2, 3):
        arms = ArmCommand(1.0, force_mN=60.0), ArmCommand(2.0, 60.0)
        sent = Command(EPOCH, seq, OWNER, arms, True, False, False, True)
        state, _ = play(
            state, (position(seq), seq * T), (Inputs(None, sent, None), seq * T + 0.004)
        )
    assert state.mode == Mode.RAMPING
    assert [one.code for one in state.faults].count(FaultCode.FREEZE_RELEASED) == 1


@pytest.mark.parametrize("held", [False, True])
def test_neither_output_is_written_until_both_are_read_back(held: bool) -> None:
    state, outputs = play(at(1.0, 2.0, held=held), (FAILED, 0.01))
    assert isinstance(outputs[0], ReadBack)
    assert waits_for_read_back(BOTH, state)
    state, outputs = play(state, (WAKE, 0.012))
    assert not [one for one in outputs if isinstance(one, SetVoltage)]
    state, _ = play(state, (Inputs(PutOut((1.0, 2.0)), None, None), 0.013))
    assert state.mode == (Mode.FROZEN if held else Mode.RAMPING)
    assert state.part_held == held
    _, outputs = play(state, (WAKE, 0.018))
    assert bool([one for one in outputs if isinstance(one, SetVoltage)]) != held


def test_if_one_output_has_released_on_its_own_the_freeze_ends_and_the_other_output_follows() -> (
    None
):
    state, _ = play(at(1.0, 2.0, held=True), (FAILED, 0.01))
    state, _ = play(state, (Inputs(PutOut((1.0, 0.0)), None, None), 0.011))
    assert (state.mode, state.part_held, state.unconfirmed) == (Mode.RAMPING, False, True)
    state, outputs = play(state, *[(WAKE, 0.011 + 0.005 * k) for k in range(12)])
    written = [one for one in outputs if isinstance(one, SetVoltage)]
    assert {one.voltages_V[1] for one in written} == {0.0}
    assert written[-1] == SetVoltage((0.0, 0.0))
    assert state.mode == Mode.LATCHED


def test_an_output_that_cannot_report_is_assumed_at_its_commanded_voltage() -> None:
    invalid = Inputs(fault(FaultCode.INSTRUMENT_INVALID, "overloaded"), None, None)
    state, _ = play(at(1.0, 2.0), (FAILED, 0.01), (invalid, 0.011))
    assert (state.arms[0].voltage_V, state.arms[1].voltage_V, state.located) == (1.0, 2.0, True)
    state, _ = play(at(0.0, 2.0), (FAILED, 0.01), (invalid, 0.011))
    assert (state.mode, state.arms[1].voltage_V) == (Mode.RAMPING, 2.0)


def test_the_rig_is_at_rest_only_if_both_outputs_are_at_the_safe_voltage() -> None:
    state, _ = play(at(1.0, 2.0), (FAILED, 0.01))
    one = found(BOTH, state, (0.0, 2.0), 0.011)
    assert one.mode == Mode.RAMPING
    both = found(BOTH, state, (0.0, 0.0), 0.011)
    assert both.mode == Mode.LATCHED


def test_the_watchdogs_of_a_frozen_part_are_not_fed_if_one_output_is_unknown() -> None:
    """An output without heartbeats releases: the other must not press alone."""
    state, _ = play(at(1.0, 2.0, held=True), (FAILED, 0.01))
    assert state.mode == Mode.FROZEN
    assert not may_kick_watchdog(BOTH, state, 0.02)
    known = found(BOTH, state, (1.0, 2.0), 0.02)
    assert may_kick_watchdog(BOTH, known, 0.02)


def test_a_shutdown_waits_for_both_arms() -> None:
    state = at(1.0, 2.0)
    alone = with_voltages(state, 0.0, 2.0)
    alone, at_rest = shutdown(BOTH, alone, 1.0)
    assert (alone.mode, at_rest) == (Mode.RAMPING, False)
    assert shutdown(BOTH, at_safe(BOTH, state), 1.0)[1]


def test_a_ramp_of_only_the_second_arm_is_reported() -> None:
    state = with_voltages(at(1.0, 2.0), 0.0, 2.0)
    state = ramped(trip(BOTH, state, Cause.ESTOP, 0.01), 0.01)
    _, outputs = play(state, (WAKE, 0.012))
    assert isinstance(outputs[0], SetVoltage)
    first_V, second_V = outputs[0].voltages_V
    assert first_V == 0.0
    assert 0.0 < second_V < 2.0


def test_the_state_after_a_read_back_has_the_present_voltages_of_both_outputs() -> None:
    state = initialize_from_output(BOTH, at(1.0, 2.0, held=True), (1.0, 2.0))
    assert state.part_held
    state = initialize_from_output(BOTH, state, (1.0, 0.4))
    assert (state.arms[1].voltage_V, state.part_held) == (0.4, False)
    assert differs(state, (1.0, 0.5))
    assert not differs(state, (1.0, 0.4))
    assert differs(state, (1.2, 0.4))
    rests = with_voltages(state, 1.0, 0.0)
    assert not differs(rests, (1.0, READ_BACK_V))
    assert differs(rests, (1.0, 1.1 * READ_BACK_V))


def test_a_trip_between_two_ticks_of_lockstep_opens_both_arms() -> None:
    lockstep = dataclasses.replace(BOTH, lockstep=True)
    state, _, _ = handle(lockstep, start(lockstep), Reset(acknowledge=True), 0.0)
    state = with_voltages(state, 0.0, 1.0)
    _, _, outputs = handle(lockstep, state, Trip(Cause.ESTOP, release_now=True), 0.0)
    assert outputs[0] == SetVoltage((0.0, 0.0))


def test_an_arming_takes_over_both_voltages() -> None:
    assert "arms" in SERVICE.state_snapshot
    state, _ = play(at(1.0, 2.0), (FAILED, 0.01))
    assert "second arm: no answer" in applied_text(
        next(one for one in play(state, (WAKE, 1.0))[1] if isinstance(one, Applied))
    )
