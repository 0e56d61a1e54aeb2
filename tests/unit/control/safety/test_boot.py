"""Interpretation of a boot, depending on how the previous actuator ended."""

import pytest
from msgspec.structs import replace

from pincette.control.safety.causes import Cause, Mode, Predecessor
from pincette.control.safety.latch import booted, ending, reset, reset_objection
from pincette.control.safety.state import SafetyState

from .bench import LIMITS

FRESH = SafetyState()


@pytest.mark.parametrize("before", Predecessor)
def test_a_boot_counts_as_a_restart_only_if_the_previous_program_has_died(
    before: Predecessor,
) -> None:
    state = booted(FRESH, before)
    assert state.mode == Mode.LATCHED
    assert state.predecessor == before
    assert (state.cause == Cause.RESTART) == (before == Predecessor.DIED)
    asks = reset_objection(LIMITS, state, acknowledged=False)
    assert bool(asks) == (before == Predecessor.DIED)
    assert not reset_objection(LIMITS, state, acknowledged=True)


@pytest.mark.parametrize("before", Predecessor)
def test_a_program_that_ends_before_it_was_reset_passes_on_how_its_predecessor_ended(
    before: Predecessor,
) -> None:
    assert ending(booted(FRESH, before)) == before


def test_a_program_that_ends_idle_with_a_free_arm_has_ended_cleanly() -> None:
    idle = reset(LIMITS, booted(FRESH, Predecessor.DIED))
    assert ending(idle) == Predecessor.CLEAN
    assert ending(replace(idle, part_held=True)) == Predecessor.DIED
    assert ending(replace(idle, unconfirmed=True)) == Predecessor.DIED


@pytest.mark.parametrize("mode", [Mode.ARMED, Mode.FROZEN, Mode.RAMPING])
def test_a_program_that_ends_during_a_motion_has_not_ended_cleanly(mode: Mode) -> None:
    assert ending(replace(FRESH, mode=mode, predecessor=Predecessor.CLEAN)) == Predecessor.DIED


def test_an_uncleared_latch_is_not_a_clean_end() -> None:
    for cause in (Cause.ESTOP, Cause.COMMAND_AGE, Cause.RESTART):
        assert ending(replace(FRESH, cause=cause)) == Predecessor.DIED
