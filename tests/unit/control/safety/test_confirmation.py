"""An output that has failed: when it is read back, and the effect of its reply."""

import pytest
from msgspec.structs import replace

from pincette.control.safety.arm import ArmOutput
from pincette.control.safety.causes import Cause, Mode
from pincette.control.safety.confirmation import (
    READ_BACK_V,
    failed,
    found,
    needs_no_write,
    read_back_due,
    suspended,
    waits_for_read_back,
)
from pincette.control.safety.latch import not_located, pass_time, reset
from pincette.control.safety.state import SafetyState
from pincette.core.wording import fault_text

from .bench import LIMITS, LOCKSTEP, T

LOST = failed(SafetyState(mode=Mode.RAMPING, cause=Cause.DEVICE, arms=(ArmOutput(3.0, 3.0),)))


def test_a_failed_output_is_read_back_at_once_and_then_once_per_period() -> None:
    assert waits_for_read_back(LIMITS, LOST)
    assert read_back_due(LIMITS, LOST, 1.0)
    requested = replace(LOST, asked_s=1.0)
    assert not read_back_due(LIMITS, requested, 1.0 + 0.9 * T)
    assert read_back_due(LIMITS, requested, 1.0 + T)


@pytest.mark.parametrize(
    "state",
    [
        replace(LOST, located=True),
        replace(LOST, unconfirmed=False),
        replace(LOST, mode=Mode.ARMED),
        replace(LOST, mode=Mode.IDLE),
    ],
)
def test_an_output_that_has_replied_or_is_not_tripped_is_not_read_back(state: SafetyState) -> None:
    assert not waits_for_read_back(LIMITS, state)
    assert not read_back_due(LIMITS, state, 1.0)


def test_in_lockstep_nothing_is_read_back() -> None:
    assert not waits_for_read_back(LOCKSTEP, LOST)
    assert not not_located(LOCKSTEP, LOST)


def test_without_a_confirmation_the_voltage_stays_until_the_end_of_the_ramp() -> None:
    under_way = pass_time(LIMITS, replace(LOST, since_s=1.0), 1.01)
    assert (under_way.mode, under_way.arms[0].voltage_V) == (Mode.RAMPING, 3.0)
    over = pass_time(LIMITS, replace(LOST, since_s=1.0, part_held=True), 1.04)
    assert (over.mode, over.arms[0].voltage_V, over.part_held) == (Mode.LATCHED, 3.0, False)
    assert over.unconfirmed


@pytest.mark.parametrize("mode", [Mode.RAMPING, Mode.LATCHED])
def test_the_ramp_starts_at_the_reported_voltage_without_being_confirmed_by_it(mode: Mode) -> None:
    state = found(LIMITS, replace(LOST, mode=mode), (2.5,), 7.0)
    assert (state.mode, state.arms[0].voltage_V, state.arms[0].ramp_from_V, state.since_s) == (
        Mode.RAMPING,
        2.5,
        2.5,
        7.0,
    )
    assert (state.unconfirmed, state.located) == (True, True)
    assert pass_time(LIMITS, state, 7.01).arms[0].voltage_V < 2.5


@pytest.mark.parametrize("found_V", [0.0, READ_BACK_V, -READ_BACK_V])
def test_an_output_at_the_safe_voltage_is_safe(found_V: float) -> None:
    state = found(LIMITS, replace(LOST, part_held=True), (found_V,), 7.0)
    assert (state.mode, state.arms[0].voltage_V, state.part_held) == (
        Mode.LATCHED,
        LIMITS.safe_V,
        False,
    )
    assert not state.unconfirmed


def test_a_read_back_in_a_freeze_keeps_voltage_and_part_unless_the_output_has_released() -> None:
    frozen = replace(LOST, mode=Mode.FROZEN, part_held=True)
    kept = found(LIMITS, frozen, (2.9,), 7.0)
    assert (kept.mode, kept.arms[0].voltage_V, kept.part_held, kept.unconfirmed) == (
        Mode.FROZEN,
        2.9,
        True,
        False,
    )
    assert found(LIMITS, frozen, (1.5,), 7.0).part_held, "as near to both"
    assert not found(LIMITS, frozen, (0.1,), 7.0).part_held


@pytest.mark.parametrize("cause", [Cause.BOOT, Cause.RESTART])
def test_a_read_back_after_a_boot_keeps_the_voltage_that_was_found(cause: Cause) -> None:
    state = found(LIMITS, replace(LOST, mode=Mode.LATCHED, cause=cause), (2.5,), 7.0)
    assert (state.mode, state.arms[0].voltage_V, state.unconfirmed) == (Mode.LATCHED, 2.5, False)


def test_a_read_back_without_a_trip_only_updates_the_voltage() -> None:
    state = found(LIMITS, replace(LOST, mode=Mode.IDLE), (2.5,), 7.0)
    assert (state.mode, state.arms[0].voltage_V) == (Mode.IDLE, 2.5)


def test_an_output_that_needs_no_write_is_not_written() -> None:
    for mode in (Mode.IDLE, Mode.FROZEN):
        assert needs_no_write(replace(LOST, mode=mode))
    latched = replace(LOST, mode=Mode.LATCHED)
    assert not needs_no_write(latched)
    assert not needs_no_write(replace(latched, located=True))
    assert not needs_no_write(replace(latched, unconfirmed=False))
    safe = replace(latched, located=True, unconfirmed=False)
    assert needs_no_write(safe)
    assert not needs_no_write(replace(safe, mode=Mode.ARMED))
    assert not needs_no_write(reset(LIMITS, replace(safe, cause=Cause.DEVICE, mode=Mode.ARMED)))
    assert not reset(LIMITS, safe).located


def test_a_suspension_of_the_machine_trips_an_armed_actuator() -> None:
    for held, mode in ((True, Mode.FROZEN), (False, Mode.RAMPING)):
        armed = replace(LOST, mode=Mode.ARMED, part_held=held, unconfirmed=False)
        state = suspended(LIMITS, armed, 3600.0, 7.0)
        assert (state.mode, state.cause) == (mode, Cause.SUSPEND)
        assert fault_text(state.faults[0]) == "the machine was suspended for 3600.0 s"
        assert read_back_due(LIMITS, state, 7.0), "the watchdog of the output may have tripped"


def test_a_suspension_of_a_tripped_rig_keeps_its_cause_and_of_an_idle_rig_is_ignored() -> None:
    latched = replace(LOST, mode=Mode.LATCHED, unconfirmed=False, located=True)
    state = suspended(LIMITS, latched, 5.0, 7.0)
    assert (state.cause, state.unconfirmed, state.located) == (Cause.DEVICE, True, False)
    idle = replace(LOST, mode=Mode.IDLE, unconfirmed=False)
    assert suspended(LIMITS, idle, 5.0, 7.0) == idle
