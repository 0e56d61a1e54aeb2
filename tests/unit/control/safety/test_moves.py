"""Time of the last voltage change, a safe voltage other than 0 V, and other numbers at their
edges."""

from dataclasses import replace as changed

import pytest
from msgspec.structs import replace

from pincette.control.faults import FaultCode, fault
from pincette.control.safety.arm import ArmOutput
from pincette.control.safety.causes import Cause, Mode
from pincette.control.safety.confirmation import failed, found, read_back_due, suspended
from pincette.control.safety.latch import pass_time, reset
from pincette.control.safety.monitors import QUIET, Watch
from pincette.control.safety.state import SafetyState

from .bench import LIMITS, LOCKSTEP, T, ready, ticked, with_arm

HIGH = replace(
    SafetyState(), mode=Mode.RAMPING, cause=Cause.DEVICE, arms=(ArmOutput(3.0),), part_held=True
)
SAFE_1_V = changed(LIMITS, safe_V=1.0)
EXCESS = fault(FaultCode.FORCE_BEYOND_LIMIT, force_mN=60.0, limit_mN=50.0)


def test_in_lockstep_a_tick_moves_by_one_slew_limit() -> None:
    assert ticked(ready(LOCKSTEP), 0, limits=LOCKSTEP, voltage_V=4.0).arms[0].voltage_V == 0.5


def test_an_unchanged_voltage_does_not_count_as_a_move() -> None:
    state = ticked(ready(), 0, voltage_V=0.3)
    moved_s = state.moved_s
    assert moved_s == 0.004
    assert ticked(state, 1, voltage_V=0.3).moved_s == moved_s
    assert ticked(state, 1, voltage_V=0.4).moved_s == T + 0.004


def test_each_step_of_a_ramp_counts_as_a_move() -> None:
    ramping = replace(with_arm(HIGH, ramp_from_V=3.0), since_s=1.0)
    under_way = pass_time(LIMITS, ramping, 1.01)
    assert (under_way.mode, under_way.moved_s) == (Mode.RAMPING, 1.01)
    over = pass_time(LIMITS, ramping, 1.04)
    assert (over.mode, over.moved_s) == (Mode.LATCHED, 1.04)


def test_an_output_that_does_not_answer_ends_its_ramp_at_its_end_exactly() -> None:
    age = changed(LIMITS.age, wake_s=0.25)
    limits = changed(LIMITS, age=age, ramp_s=0.5)
    assert pass_time(limits, failed(HIGH), 0.25).mode == Mode.LATCHED


@pytest.mark.parametrize(("found_V", "held"), [(1.2, False), (2.9, True), (2.0, True)])
def test_a_part_counts_as_released_near_any_safe_voltage(found_V: float, held: bool) -> None:
    frozen = failed(replace(HIGH, mode=Mode.FROZEN))
    assert found(SAFE_1_V, frozen, (found_V,), 7.0).part_held == held


def test_an_output_at_a_safe_voltage_beyond_0_V_is_safe() -> None:
    assert found(SAFE_1_V, failed(HIGH), (1.0,), 7.0).mode == Mode.LATCHED


def test_the_output_is_read_back_again_after_exactly_a_period() -> None:
    assert read_back_due(LIMITS, replace(failed(HIGH), asked_s=0.0), T)


def test_a_trip_by_a_suspension_begins_when_the_suspension_is_noticed() -> None:
    slept = suspended(LIMITS, ticked(ready(), 0, part_held=True), 3600.0, 7.0)
    assert (slept.mode, slept.since_s) == (Mode.FROZEN, 7.0)


def test_a_reset_clears_a_read_back() -> None:
    state = reset(LIMITS, replace(HIGH, mode=Mode.LATCHED, unconfirmed=True, located=True))
    assert (state.unconfirmed, state.located) == (False, False)


def test_one_sample_within_the_limit_lowers_the_count_by_one() -> None:
    assert Watch(2, EXCESS).leak(None) == Watch(1, EXCESS)
    assert Watch(1, EXCESS).leak(None) == QUIET
