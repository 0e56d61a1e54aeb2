"""Which commands take effect, wait, are refused, or trip."""

from math import inf, nan
from typing import Any

import pytest
from msgspec.structs import replace

from pincette.control.safety.admission import (
    CommandFacts,
    authority_fault,
    is_future,
    judged,
    nonsense,
    sampled,
)
from pincette.control.safety.arm import ArmFacts
from pincette.control.safety.causes import Cause
from pincette.control.safety.latch import pass_time, trip
from pincette.control.safety.state import SafetyState
from pincette.control.safety.voltage import SLEW_UP, VOLTAGE_MAX
from pincette.core.wording import fault_text

from .bench import (
    EPOCH,
    GOOD,
    LIMITS,
    OFF,
    OWNER,
    T,
    cause_words,
    command,
    detail_words,
    held,
    offered,
    ready,
    ticked,
)

FREE = ticked(ready(), 0)


def after(state: SafetyState, **changes: Any) -> SafetyState:
    """Submit sample 1, and 4 ms later a good command with other values of some fields."""
    return ticked(state, 1, **changes)


def test_a_valid_command_sets_the_new_state() -> None:
    state = after(replace(FREE, blind=OFF, excused_s=0.1), voltage_V=0.75, part_held=True)
    assert (state.mode, state.arms[0].voltage_V, state.part_held) == ("armed", 0.75, True)
    assert (state.taken_seq, state.fresh_s) == (1, T)
    assert (state.arms[0].limits_active, state.blind, state.excused_s) == (0, None, 0.0)
    assert (state.refused, state.refusal) == (0, None)


def test_active_limits_are_reported() -> None:
    state = after(FREE, voltage_V=9.0)
    assert (state.arms[0].voltage_V, state.arms[0].limits_active) == (1.0, VOLTAGE_MAX | SLEW_UP)


def test_a_final_command_ends_the_arming_at_its_voltage() -> None:
    state = after(FREE, voltage_V=0.75, final=True)
    assert (state.mode, state.arms[0].voltage_V) == ("idle", 0.75)
    assert ticked(state, 2, voltage_V=1.0).arms[0].voltage_V == 0.75


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"epoch": 12}, "command of epoch 12, armed for 11"),
        ({"epoch": 0}, "command of epoch 0, armed for 11"),
        ({"owner": 6}, "command of owner 6, armed for 5"),
        ({"seq": 10}, "command 10 is ahead, the newest sample is 1"),
        ({"seq": 2**40}, f"command {2**40} is ahead, the newest sample is 1"),
    ],
)
def test_commands_without_authority_are_ignored(changes: dict[str, Any], words: str) -> None:
    state = sampled(LIMITS, FREE, 1, (1.0,), T)
    refused = offered(state, command(**({"seq": 1} | changes)), T + 0.004)
    assert (refused.refused, fault_text(refused.refusal)) == (1, words)
    kept = replace(refused, refused=0, refusal=None, unauthorized=state.unauthorized)
    assert kept == state
    assert (refused.unauthorized.count, refused.unauthorized.newest) == (1, refused.refusal)


def test_a_command_may_be_ahead_of_the_newest_sample_by_as_many_numbers_as_samples_are_stored() -> (
    None
):
    assert authority_fault(FREE, command(seq=8)) is None
    assert authority_fault(FREE, command(seq=9)) is not None


def test_unauthorized_commands_raise_an_alarm_at_the_third_and_do_not_trip() -> None:
    state = FREE
    for seq in range(1, 10):
        state = ticked(state, seq)
        assert ("alarm" in detail_words(state)) is (seq > 3)
        state = offered(state, command(seq=seq, owner=9), seq * T + 0.005)
    assert (state.mode, state.taken_seq, state.unauthorized.count) == ("armed", 9, 9)
    assert "alarm: 9 commands from another controller refused" in detail_words(state)
    assert "command of owner 9, armed for 5" in detail_words(state)


def test_an_invalid_command_of_another_epoch_is_ignored_as_outdated() -> None:
    state = FREE
    for _ in range(5):
        state = offered(state, command(epoch=3, valid=False), 0.01)
    assert (state.refused, state.unauthorized.count) == (0, 0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"voltage_V": nan}, "command 1: nan V is not a voltage"),
        ({"voltage_V": 1e9}, "command 1: 1e+09 V is impossible, the range is -1.0 V to 4.0 V"),
        ({"force_mN": inf}, "command 1: nan mN is not a force"),
        ({"force_mN": nan}, "command 1: nan mN is not a force"),
        ({"x_d_um": -inf}, "command 1: nan µm is not a position"),
        ({"sweep_V": 0.2}, "sweep of ±0.2 V, limit ±0.1 V"),
        ({"sweep_V": nan}, "sweep of ±nan V, limit ±0.1 V"),
    ],
)
def test_impossible_numbers_are_refused_in_the_same_cycle(
    changes: dict[str, Any], words: str
) -> None:
    state = after(replace(FREE, blind=OFF), **changes)
    assert (state.refused, fault_text(state.refusal), state.unauthorized.count) == (1, words, 0)
    assert (state.mode, state.arms[0].voltage_V, state.taken_seq) == ("armed", 0.5, 0)
    assert state.blind == OFF


def test_commands_without_a_voltage_for_three_samples_trip_like_missing_commands() -> None:
    state = FREE
    for seq in (1, 2, 3):
        state = pass_time(LIMITS, ticked(state, seq, voltage_V=nan), seq * T + 0.004)
    assert state.mode == "ramping"


def test_a_command_with_nan_is_invalid_but_optional_values_may_be_missing() -> None:
    assert nonsense(LIMITS.arms[0].voltage, 0.5, None, None) is None
    assert nonsense(LIMITS.arms[0].voltage, 0.5, 1.0, 2.0) is None


def test_a_sweep_within_its_limits_is_accepted() -> None:
    assert after(FREE, sweep_V=0.1).taken_seq == 1


def test_a_command_waits_for_its_own_sample_only() -> None:
    assert is_future(FREE, command(seq=1))
    assert not is_future(FREE, GOOD)
    assert is_future(ready(), GOOD)


@pytest.mark.parametrize("seq", [1, 0])
def test_each_number_is_accepted_once_and_in_order(seq: int) -> None:
    state = after(FREE)
    again = offered(state, command(seq=seq, voltage_V=0.9), T + 0.005)
    assert (again.arms[0].voltage_V, fault_text(again.refusal)) == (0.5, f"command {seq} after 1")


def test_a_command_whose_sample_was_not_received_is_refused() -> None:
    state = sampled(LIMITS, FREE, 3, (1.0,), 3 * T)
    state = offered(state, command(seq=2), 3 * T)
    assert (fault_text(state.refusal), state.refused) == (
        "command 2: its sample is unknown here",
        1,
    )
    assert state.taken_seq == 0


def test_a_command_for_a_lost_sample_has_the_age_of_the_previous_sample() -> None:
    state = sampled(LIMITS, FREE, 2, (1.0,), 2 * T)
    state = offered(state, command(seq=1), 2 * T)
    assert (state.refusal, state.taken_seq) == (None, 1)
    assert state.fresh_s == FREE.arrivals[-1].at_s
    late = sampled(LIMITS, FREE, 2, (1.0,), 2.6 * T)
    late = offered(late, command(seq=1), 2.6 * T)
    assert (fault_text(late.refusal), late.refused) == ("command 1: 52 ms old, limit 50 ms", 1)


def test_a_late_command_is_refused() -> None:
    state = sampled(LIMITS, FREE, 1, (1.0,), T)
    state = offered(state, command(seq=1), T + 0.051)
    assert fault_text(state.refusal) == "command 1: 51 ms old, limit 50 ms"


def test_a_command_from_a_queue_is_refused() -> None:
    state = FREE
    for seq in (1, 2, 3, 4):
        state = sampled(LIMITS, state, seq, (1.0,), 0.021)
    state = offered(state, command(seq=1), 0.022)
    assert fault_text(state.refusal) == "command 1: 3 samples old, limit 2"


@pytest.mark.parametrize(("mode", "cause"), [("idle", ""), ("latched", "estop")])
def test_no_command_is_accepted_unless_the_actuator_is_armed(mode: str, cause: str) -> None:
    state = after(replace(FREE, mode=mode, cause=cause), voltage_V=0.9, force_mN=90.0)
    assert (state.arms[0].voltage_V, fault_text(state.refusal), state.mode) == (
        0.5,
        "command 1: the actuator is not armed",
        mode,
    )
    assert state.arms[0].watches == FREE.arms[0].watches


def test_an_invalid_command_is_never_accepted_and_its_reason_is_stored() -> None:
    state = after(FREE, valid=False, fault=OFF, voltage_V=0.9)
    assert (state.arms[0].voltage_V, state.blind, state.refused) == (0.5, OFF, 0)


def forced(state: SafetyState, seqs: range, **changes: Any) -> SafetyState:
    for seq in seqs:
        state = ticked(state, seq, **changes)
    return state


@pytest.mark.parametrize("valid", [True, False])
def test_a_force_beyond_the_limit_releases_a_part(valid: bool) -> None:
    pressed = {"force_mN": 55.0, "part_held": True, "valid": valid}
    assert forced(held(), range(1, 3), **pressed).mode == "armed"
    state = forced(held(), range(1, 4), **pressed)
    assert (state.mode, state.since_s) == ("ramping", 3 * T + 0.004)
    assert cause_words(state) == "force: 55.0 mN, limit 50.0 mN, 3 samples in a row"
    assert forced(held(), range(1, 20), force_mN=50.0, part_held=True).mode == "armed"


def test_an_arm_that_does_not_follow_freezes_or_ramps() -> None:
    astray: dict[str, Any] = {"x_d_um": 9.0}
    assert forced(FREE, range(1, 6), **astray).mode == "armed"
    state = forced(FREE, range(1, 7), **astray)
    assert (state.mode, state.cause) == ("ramping", "following_error")
    assert forced(held(), range(1, 7), **astray, part_held=True).mode == "frozen"
    assert forced(FREE, range(1, 30), x_d_um=4.0).mode == "armed"


@pytest.mark.parametrize(("state", "mode"), [(FREE, "ramping"), (held(), "frozen")])
def test_a_position_beyond_the_limits_trips_without_waiting_for_a_command(
    state: SafetyState, mode: str
) -> None:
    for seq in (1, 2):
        state = sampled(LIMITS, state, seq, (80.0,), seq * T)
        assert state.mode == "armed"
    state = sampled(LIMITS, state, 3, (80.0,), 3 * T)
    assert (state.mode, state.since_s) == (mode, 3 * T)
    assert cause_words(state).startswith("position: 80.00 µm")


def test_an_invalid_measurement_is_not_a_position() -> None:
    state = FREE
    for seq in range(1, 9):
        state = sampled(LIMITS, state, seq, (None,), seq * T)
    assert (state.mode, state.arms[0].watches) == ("armed", FREE.arms[0].watches)
    assert state.arrivals[-1].x_um == (None,)


@pytest.mark.parametrize("mode", ["idle", "latched", "frozen", "ramping"])
def test_outside_an_arming_no_position_trips(mode: str) -> None:
    state = replace(FREE, mode=mode, cause=Cause.LEASE)
    for seq in range(1, 9):
        state = sampled(LIMITS, state, seq, (900.0,), seq * T)
    assert (state.mode, state.cause, state.arms[0].watches) == (mode, "lease", FREE.arms[0].watches)


def test_an_older_sample_changes_nothing() -> None:
    assert sampled(LIMITS, FREE, 0, (900.0,), 1.0) is FREE


def test_a_growing_force_releases_a_frozen_part() -> None:
    frozen = trip(LIMITS, held(), Cause.ESTOP, 0.01)
    blind: dict[str, Any] = {"valid": False, "force_mN": 55.0}
    assert forced(frozen, range(1, 3), **blind).mode == "frozen"
    state = forced(frozen, range(1, 4), **blind)
    assert (state.mode, state.arms[0].ramp_from_V, state.since_s) == ("ramping", 0.5, 3 * T + 0.004)
    assert cause_words(state) == (
        "estop: an emergency stop was requested; "
        "released: 55.0 mN, limit 50.0 mN, 3 samples in a row"
    )
    kept = forced(frozen, range(1, 30), valid=False, force_mN=49.0, x_d_um=900.0)
    assert (kept.mode, kept.cause) == ("frozen", "estop")


@pytest.mark.parametrize("changes", [{"epoch": 12}, {"owner": 6}])
def test_an_unauthorized_command_cannot_release_a_part(changes: dict[str, Any]) -> None:
    frozen = trip(LIMITS, held(), Cause.ESTOP, 0.01)
    assert forced(frozen, range(1, 9), force_mN=99.0, **changes).mode == "frozen"


def test_force_and_target_of_a_command_are_optional() -> None:
    arm = ArmFacts(0.5)
    bare = CommandFacts(EPOCH, OWNER, 1, (arm,), part_held=False, final=False, valid=True)
    assert (bare.fault, bare.sweep_V, arm.force_mN, arm.x_d_um) == (None, None, None, None)
    state = judged(LIMITS, sampled(LIMITS, FREE, 1, (1.0,), T), bare, T)
    assert (state.taken_seq, state.arms[0].watches.seq) == (1, 1)
