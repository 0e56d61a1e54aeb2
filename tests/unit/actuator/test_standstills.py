"""Stalls of the machine that the actuator discounts, and for how long."""

from pincette.core.messages import Arm, Reset
from pincette.core.service import Busy
from pincette_actuator.requests import handle
from pincette_actuator.step import Inputs, start

from .bench import CONFIG, EPOCH, OWNER, WAKE, T, command, holding, play, position, wakes


def test_a_stall_of_the_actuator_does_not_count_as_age() -> None:
    """The machine stalled for 40 ms: the command that follows is accepted, as it is in time."""
    state, _ = play(holding(held=True), *wakes(0.005, 0.02))
    state, _ = play(state, (WAKE, 0.065), (position(1), 0.066), (command(1, 1.5), 0.068))
    assert (state.mode, state.arms[0].voltage_V, state.standstills) == ("armed", 1.5, 1)


def test_after_a_stall_a_silence_trips_at_its_age_limit() -> None:
    state, _ = play(holding(held=False), *wakes(0.005, 0.02), (WAKE, 0.065))
    assert state.mode == "armed"
    stood_s = 0.065 - 0.02
    state, _ = play(state, *wakes(0.07, 0.060 + stood_s))
    assert state.mode == "ramping"


def test_stalls_are_excused_up_to_a_limit() -> None:
    state, now = holding(held=False), 0.004
    for _ in range(20):
        now += 0.045
        state, _ = play(state, (WAKE, now))
    assert state.mode != "armed"


def test_a_stall_causes_no_jump_in_the_ramp() -> None:
    state, _ = play(holding(2.0, held=False), *wakes(0.005, 0.065))
    assert state.mode == "ramping"
    before_V = state.arms[0].voltage_V
    state, _ = play(state, (WAKE, 0.2))
    assert before_V - state.arms[0].voltage_V <= 2 * 2.0 * (T / 4) / CONFIG.ramp_s + 1e-9


def test_computing_time_of_the_own_program_is_not_a_stall() -> None:
    """Time is subtracted from an age only if the machine caused the delay."""
    state, _ = play(holding(held=False), *wakes(0.005, 0.02))
    kept = (Inputs(Busy(0.04), None, None), 0.061)
    state, _ = play(state, kept)
    assert (state.mode, state.cause, state.standstills) == ("ramping", "command_age", 0)


def test_a_ramp_continues_by_its_clock_while_its_program_waits_for_its_sensor() -> None:
    state, _ = play(holding(2.0, held=False), *wakes(0.005, 0.065))
    wait_s, now = 1.5 * CONFIG.age.wake_s, 0.065
    while now < 0.065 + CONFIG.ramp_s:
        # With the write of the ramp's voltage it is more than two timer intervals.
        now += wait_s + 0.6 * CONFIG.age.wake_s
        state, _ = play(state, (Inputs(Busy(wait_s), None, None), now))
    assert (state.mode, state.arms[0].voltage_V, state.standstills) == ("latched", CONFIG.safe_V, 0)


def test_a_stall_of_the_machine_beyond_the_own_computing_time_is_subtracted_from_ages() -> None:
    state, _ = play(holding(held=False), *wakes(0.005, 0.02))
    state, _ = play(state, (Inputs(Busy(0.006), None, None), 0.065))
    assert (state.mode, state.standstills) == ("armed", 1)


def test_the_long_interval_between_checks_at_rest_is_not_a_stall() -> None:
    """None of the checks lengthens the first age after an arming."""
    state, _, _ = handle(CONFIG, start(CONFIG), Reset(acknowledge=True), 0.0)
    state, _ = play(state, *((WAKE, 0.05 * look) for look in range(1, 20)))
    assert (state.mode, state.standstills) == ("idle", 0)
    state, _, _ = handle(CONFIG, state, Arm(EPOCH, OWNER, ""), 1.0)
    state, _ = play(state, *wakes(1.004, 1.0 + CONFIG.age.grace_s + CONFIG.age.limit_s - 0.001))
    assert state.mode == "armed"
    state, _ = play(state, (WAKE, 1.0 + CONFIG.age.grace_s + CONFIG.age.limit_s + 0.001))
    assert (state.mode, state.cause, state.standstills) == ("ramping", "command_age", 0)
