"""Transitions between modes: arming, trip, freeze, ramp, latch, reset, and the end of the
program."""

import pytest

from pincette.control.faults import FaultCode, fault
from pincette.control.record import replace
from pincette.control.safety.admission import sampled
from pincette.control.safety.arm import ArmOutput
from pincette.control.safety.causes import Cause, Mode
from pincette.control.safety.latch import (
    account_for_stall,
    armed,
    arming_objection,
    explained,
    pass_time,
    released,
    reset,
    reset_objection,
    shutdown,
    trip,
)
from pincette.control.safety.monitors import Watch, Watches
from pincette.control.safety.state import SafetyState, UnauthorizedCommands

from .bench import (
    EPOCH,
    LIMITS,
    LOCKSTEP,
    OFF,
    OWNER,
    cause_words,
    detail_words,
    held,
    ready,
    ticked,
    with_arm,
)

FREE = ticked(ready(), 0)
HELD = held()
PRESSED = fault(FaultCode.FORCE_BEYOND_LIMIT, force_mN=55.0, limit_mN=50.0)


def test_the_actuator_boots_latched_without_authority() -> None:
    state = SafetyState()
    assert (state.mode, state.cause, state.epoch, state.owner) == ("latched", "boot", 0, 0)
    assert (state.arms[0].voltage_V, state.part_held, state.refused, state.refusal) == (
        0.0,
        False,
        0,
        None,
    )
    assert (state.taken_seq, state.fresh_s, state.arrivals, state.ran_s) == (-1, 0.0, (), None)
    assert state.unconfirmed is False


@pytest.mark.parametrize(
    ("mode", "cause", "words"),
    [
        ("idle", "", ""),
        ("latched", "boot", "the actuator is latched (boot): reset it first"),
        ("armed", "", "the actuator is armed (armed): wait until it has ended"),
        ("frozen", "estop", "the actuator is frozen (estop): wait until it has ended"),
        ("ramping", "estop", "the actuator is ramping (estop): wait until it has ended"),
    ],
)
def test_only_an_idle_actuator_is_armed(mode: str, cause: str, words: str) -> None:
    assert arming_objection(replace(FREE, mode=mode, cause=cause)) == words


def test_before_its_first_sample_an_arming_may_be_replaced_by_another() -> None:
    assert arming_objection(ready()) == ""
    words = "the actuator is armed (armed): wait until it has ended"
    assert arming_objection(FREE) == words
    assert arming_objection(sampled(LIMITS, ready(), 0, (1.0,), 0.0)) == words


def test_an_arming_resets_everything_but_voltage_part_and_counters() -> None:
    used = replace(
        with_arm(
            HELD,
            ramp_from_V=2.0,
            limits_active=5,
            watches=Watches(4, Watch(2, PRESSED), Watch(1, OFF), Watch(1, OFF), 4, 1.0),
        ),
        mode=Mode.IDLE,
        cause=Cause.ESTOP,
        since_s=3.0,
        faults=(PRESSED,),
        blind=OFF,
        excused_s=0.1,
        standstills=2,
        refused=7,
        refusal=OFF,
        unauthorized=UnauthorizedCommands(9, OFF),
        ran_s=4.0,
    )
    state = armed(LIMITS, used, epoch=12, owner=6, now=5.0)
    fresh = SafetyState(
        mode=Mode.ARMED,
        cause=Cause.NONE,
        epoch=12,
        owner=6,
        arms=(ArmOutput(used.arms[0].voltage_V),),
        moved_s=used.moved_s,
        slewing_s=used.slewing_s,
        part_held=True,
        fresh_s=5.0 + LIMITS.age.grace_s,
        ran_s=5.0,
        standstills=2,
        refused=7,
    )
    assert state == fresh


@pytest.mark.parametrize(("state", "mode"), [(FREE, "ramping"), (HELD, "frozen")])
def test_the_mode_after_a_trip_follows_from_part_and_voltage(state: SafetyState, mode: str) -> None:
    tripped = trip(LIMITS, with_arm(state, limits_active=3), Cause.ESTOP, 0.01)
    assert (tripped.mode, tripped.cause, tripped.since_s) == (mode, "estop", 0.01)
    assert tripped.arms[0].limits_active == 0
    assert tripped.arms[0].voltage_V == state.arms[0].voltage_V
    if mode == "ramping":
        assert tripped.arms[0].ramp_from_V == state.arms[0].voltage_V


@pytest.mark.parametrize(("cause", "asked"), [(Cause.ESTOP, True), (Cause.FORCE, False)])
def test_a_release_ramps_with_a_part(cause: Cause, asked: bool) -> None:
    tripped = trip(LIMITS, HELD, cause, 0.01, let_go=asked)
    assert (tripped.mode, tripped.cause, tripped.part_held) == ("ramping", cause, True)
    frozen = trip(LIMITS, HELD, Cause.ESTOP, 0.01)
    let_go = trip(LIMITS, frozen, cause, 0.3, let_go=asked)
    assert (let_go.mode, let_go.cause, let_go.since_s) == ("ramping", "estop", 0.3)


@pytest.mark.parametrize("mode", ["frozen", "ramping", "latched"])
def test_a_later_trip_does_not_replace_the_cause_of_the_first(mode: str) -> None:
    before = replace(HELD, mode=mode, cause=Cause.ESTOP, since_s=1.0)
    assert trip(LIMITS, before, Cause.ABORT, 2.0) is before


@pytest.mark.parametrize("cause", ["boot", "estop"])
def test_a_release_request_moves_a_latched_arm_only_after_a_boot(cause: str) -> None:
    before = replace(HELD, mode=Mode.LATCHED, cause=cause)
    after = trip(LIMITS, before, Cause.ABORT, 2.0, let_go=True)
    assert after.mode == ("ramping" if cause == "boot" else "latched")


@pytest.mark.parametrize("mode", ["idle", "latched"])
def test_in_lockstep_a_trip_outside_an_arming_sets_the_final_voltage_at_once(mode: str) -> None:
    before = replace(HELD, mode=mode, cause=Cause.BOOT)
    kept = trip(LOCKSTEP, before, Cause.ESTOP, 1.0)
    assert (kept.mode, kept.arms[0].voltage_V, kept.part_held) == ("latched", 0.5, True)
    gone = trip(LOCKSTEP, before, Cause.ESTOP, 1.0, let_go=True)
    assert (gone.mode, gone.arms[0].voltage_V, gone.part_held, gone.cause) == (
        "latched",
        0.0,
        False,
        "estop",
    )


def test_in_lockstep_a_trip_during_an_arming_freezes_or_ramps_as_in_real_time() -> None:
    assert trip(LOCKSTEP, HELD, Cause.ESTOP, 1.0).mode == "frozen"
    assert trip(LOCKSTEP, FREE, Cause.ESTOP, 1.0).mode == "ramping"


def test_a_released_freeze_is_reported_with_its_cause() -> None:
    frozen = trip(LIMITS, HELD, Cause.ESTOP, 0.01)
    state = released(frozen, PRESSED, 0.2)
    assert (state.mode, state.since_s, state.arms[0].ramp_from_V) == ("ramping", 0.2, 0.5)
    assert cause_words(state) == (
        "estop: an emergency stop was requested; released: 55.0 mN, limit 50.0 mN"
    )


@pytest.mark.parametrize("mode", ["latched", "idle", "armed", "frozen", "ramping"])
def test_a_reset_needs_a_person_and_an_arm_that_is_safe(mode: str) -> None:
    state = replace(HELD, mode=mode, cause=Cause.ESTOP)
    refused = "a reset needs acknowledge = true"
    assert reset_objection(LIMITS, state, acknowledged=False) == refused
    assert reset_objection(LOCKSTEP, state, acknowledged=True) == ""
    words = reset_objection(LIMITS, state, acknowledged=True)
    ramping = "the actuator is ramping (estop): reset it once the arm is safe"
    assert words == (ramping if mode == "ramping" else "")


@pytest.mark.parametrize("mode", ["latched", "frozen"])
def test_a_reset_clears_the_latch_and_keeps_part_and_voltage(mode: str) -> None:
    tripped = replace(HELD, mode=mode, cause=Cause.ESTOP, faults=(OFF,), unconfirmed=True)
    state = reset(LIMITS, tripped)
    assert (state.mode, state.cause, state.faults, state.unconfirmed) == ("idle", "", (), False)
    assert (state.arms[0].voltage_V, state.part_held) == (0.5, True)


@pytest.mark.parametrize("mode", ["idle", "armed"])
def test_a_reset_without_a_trip_changes_nothing(mode: str) -> None:
    state = replace(HELD, mode=mode)
    assert reset(LIMITS, state) is state


def test_a_ramp_that_no_tick_will_end_is_ended_by_the_reset() -> None:
    state = reset(LOCKSTEP, trip(LOCKSTEP, FREE, Cause.ESTOP, 0.01))
    assert (state.mode, state.arms[0].voltage_V, state.part_held) == ("idle", 0.0, False)


def test_ages_are_corrected_only_after_a_stall() -> None:
    state = account_for_stall(LIMITS, replace(FREE, ran_s=None), 5.0)
    assert state == replace(FREE, ran_s=5.0)
    assert account_for_stall(LIMITS, state, 5.01) == replace(FREE, ran_s=5.01)


def test_a_stall_is_subtracted_from_every_age() -> None:
    before = replace(HELD, ran_s=1.0, fresh_s=0.98, since_s=0.5, excused_s=0.03)
    after = account_for_stall(LIMITS, before, 1.045)
    assert after.ran_s == 1.045
    assert after.fresh_s == pytest.approx(1.02)
    assert after.since_s == pytest.approx(0.54)
    assert after.excused_s == pytest.approx(0.07)
    assert after.standstills == 1


def test_stalls_are_not_measured_in_lockstep() -> None:
    assert account_for_stall(LOCKSTEP, replace(HELD, ran_s=1.0), 9.0) == replace(HELD, ran_s=9.0)


@pytest.mark.parametrize(("state", "mode"), [(FREE, "ramping"), (HELD, "frozen")])
def test_silence_trips_beyond_the_age_limit(state: SafetyState, mode: str) -> None:
    limit_s = state.fresh_s + LIMITS.age.limit_s
    assert pass_time(LIMITS, state, limit_s) is state
    tripped = pass_time(LIMITS, state, limit_s + 0.012)
    assert tripped.mode == mode
    assert cause_words(tripped) == "command_age: no command for 62 ms, limit 50 ms"
    assert [fault.code for fault in tripped.faults] == [FaultCode.NO_COMMAND]
    blind = pass_time(LIMITS, replace(state, blind=OFF), limit_s + 0.012)
    assert cause_words(blind) == "command_age: no command for 62 ms, limit 50 ms; sensor: laser off"


def test_a_silence_is_reported_to_the_millisecond() -> None:
    limits = replace(LIMITS, age=replace(LIMITS.age, limit_s=0.9))
    tripped = pass_time(limits, replace(FREE, fresh_s=0.25), 2.75)
    assert cause_words(tripped) == "command_age: no command for 2500 ms, limit 900 ms"


@pytest.mark.parametrize("mode", ["idle", "latched"])
def test_without_an_expected_message_silence_is_not_a_fault(mode: str) -> None:
    state = replace(HELD, mode=mode)
    assert pass_time(LIMITS, state, 100.0) is state


def test_a_freeze_ends_in_its_ramp() -> None:
    frozen = trip(LIMITS, HELD, Cause.ESTOP, 1.0)
    assert pass_time(LIMITS, frozen, 1.4999) is frozen
    state = pass_time(LIMITS, frozen, 1.5)
    assert (state.mode, state.since_s) == ("ramping", 1.5)
    assert state.arms[0].voltage_V == pytest.approx(0.5 * (1.0 - 0.005 / 0.035))


def test_the_ramp_starts_with_the_trip_and_ends_at_the_safe_voltage() -> None:
    limits = replace(LIMITS, safe_V=-0.5)
    ramping = trip(limits, FREE, Cause.ESTOP, 1.0)
    voltages = [
        pass_time(limits, ramping, 1.0 + step * 0.005).arms[0].voltage_V for step in range(7)
    ]
    expected = [0.5 - 1.0 * (step * 0.005 + 0.005) / 0.035 for step in range(6)]
    assert voltages == pytest.approx([*expected, -0.5])
    assert pass_time(limits, ramping, 1.029).mode == "ramping"
    state = pass_time(limits, replace(ramping, part_held=True), 1.0301)
    assert (state.mode, state.arms[0].voltage_V, state.part_held) == ("latched", -0.5, False)


def test_the_ramp_ends_in_the_latch_when_it_reaches_the_safe_voltage() -> None:
    limits = replace(LIMITS, ramp_s=0.03 + LIMITS.age.wake_s)
    ramping = trip(limits, FREE, Cause.ESTOP, 0.0)
    assert pass_time(limits, ramping, 0.029).mode == "ramping"
    assert pass_time(limits, ramping, 0.03).mode == "latched"


def test_on_a_stop_request_the_actuator_releases_and_ramps_once() -> None:
    at_safe = with_arm(FREE, voltage_V=0.0)
    assert shutdown(LIMITS, at_safe, 1.0) == (at_safe, True)
    state, done = shutdown(LIMITS, HELD, 1.0)
    assert (done, state.mode, state.cause, state.part_held) == (
        False,
        "ramping",
        "shutdown",
        False,
    )
    assert (state.since_s, state.arms[0].ramp_from_V) == (1.0, 0.5)
    assert shutdown(LIMITS, state, 1.01) == (state, False)
    again, _ = shutdown(LIMITS, replace(HELD, mode=Mode.FROZEN, cause=Cause.ESTOP), 1.0)
    assert (again.mode, again.cause) == ("ramping", "estop")


def test_the_detail_starts_with_what_a_person_needs_first() -> None:
    assert detail_words(SafetyState()) == "latched; boot"
    state = replace(
        HELD,
        cause=Cause.NONE,
        refusal=fault(FaultCode.COMMAND_REPEATED, seq=3, taken_seq=3),
        standstills=2,
        unauthorized=UnauthorizedCommands(3, fault(FaultCode.OTHER_OWNER, owner=7, armed_owner=5)),
    )
    assert detail_words(state) == (
        "armed; alarm: 3 commands from another controller refused; command of owner 7, armed "
        "for 5; command 3 after 3; 2 scheduling stalls"
    )
    quiet = replace(state, unauthorized=UnauthorizedCommands(2, OFF), refusal=None, standstills=0)
    assert detail_words(quiet) == "armed"
    assert (state.epoch, state.owner) == (EPOCH, OWNER)


LATE = fault(FaultCode.INSTRUMENT_LATE, "answers come late", took_s=0.04)


def test_a_trip_by_missing_commands_names_late_answers_once() -> None:
    tripped = trip(LIMITS, FREE, Cause.COMMAND_AGE, 1.0, faults=(OFF,))
    named = explained(tripped, LATE)
    assert named.faults == (OFF, LATE)
    assert explained(named, LATE) is named
    assert explained(tripped, OFF) is tripped


def test_late_answers_are_not_named_as_the_cause_of_another_trip() -> None:
    assert explained(FREE, LATE) is FREE
    stopped = trip(LIMITS, FREE, Cause.ESTOP, 1.0)
    assert explained(stopped, LATE) is stopped
