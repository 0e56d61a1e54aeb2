"""States of the loop in which the hardware watchdog is fed."""

import pytest
from msgspec.structs import replace

from pincette.control.safety.causes import Cause
from pincette.control.safety.latch import trip
from pincette.control.safety.watchdog_feed import may_kick_watchdog

from .bench import LIMITS, held, ready, ticked


def test_the_watchdog_is_fed_while_commands_arrive() -> None:
    state = ticked(ready(), 0)
    assert may_kick_watchdog(LIMITS, state, 0.05)
    assert may_kick_watchdog(LIMITS, state, 0.1)


def test_the_watchdog_is_not_fed_if_an_armed_actuator_has_missed_its_trip() -> None:
    assert not may_kick_watchdog(LIMITS, ticked(ready(), 0), 0.1001)


def test_before_the_first_command_the_grace_period_applies() -> None:
    assert may_kick_watchdog(LIMITS, ready(), 1.09)


def test_a_freeze_is_kept_by_heartbeats_for_its_time_even_without_a_confirmation() -> None:
    frozen = replace(trip(LIMITS, held(), Cause.DEVICE, 1.0), unconfirmed=True)
    assert may_kick_watchdog(LIMITS, frozen, 1.5)
    assert may_kick_watchdog(LIMITS, frozen, 1.55)
    assert not may_kick_watchdog(LIMITS, frozen, 1.5501)


@pytest.mark.parametrize("mode", ["ramping", "latched"])
def test_the_watchdog_is_not_fed_while_the_voltage_is_unconfirmed(mode: str) -> None:
    state = replace(held(), mode=mode, cause=Cause.DEVICE)
    assert may_kick_watchdog(LIMITS, state, 99.0)
    assert not may_kick_watchdog(LIMITS, replace(state, unconfirmed=True), 99.0)


def test_an_idle_rig_keeps_its_watchdog_fed_without_a_confirmation() -> None:
    assert may_kick_watchdog(LIMITS, replace(held(), mode="idle", unconfirmed=True), 99.0)
