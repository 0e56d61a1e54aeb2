"""The actuator's rules in virtual time."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.control.record import replace
from pincette.control.safety.latch import booted
from pincette.core.faults import Cause, Predecessor
from pincette.core.messages import Ack, Applied, Arm, Command, Reset, Trip
from pincette.core.messages.arms import ArmCommand
from pincette.core.service import RefusedError, SetVoltage
from pincette.core.wording import fault_text
from pincette_actuator.requests import handle
from pincette_actuator.step import SERVICE, Inputs, initialize_from_output, start, step
from tests.support.arms import with_arm

from .bench import (
    ARM,
    CONFIG,
    EPOCH,
    OFF,
    OWNER,
    WAKE,
    T,
    armed,
    cause_words,
    command,
    holding,
    play,
    position,
    wakes,
)


def test_only_a_clean_boot_is_reset_without_an_acknowledgement() -> None:
    for before in (Predecessor.NONE, Predecessor.CLEAN):
        state, _, _ = handle(CONFIG, booted(start(CONFIG), before), Reset(), 0.0)
        assert state.mode == "idle"
    died = booted(start(CONFIG), Predecessor.DIED)
    assert died.cause == Cause.RESTART
    for state in (died, replace(died, cause=Cause.COMMAND_AGE), holding(held=True)):
        with pytest.raises(RefusedError, match="acknowledge"):
            handle(CONFIG, state, Reset(), 0.0)


def test_a_valid_command_reaches_the_output_before_it_is_published() -> None:
    _, outputs = play(armed(), (position(0), 0.0), (command(0), 0.004))
    assert outputs[0] == SetVoltage((1.0,))
    applied = outputs[1]
    assert isinstance(applied, Applied)
    assert (applied.seq, applied.arms[0].voltage_V, applied.answered) == (0, 1.0, True)
    assert applied.command_age_s == pytest.approx(0.004)


def test_a_command_that_arrives_before_its_sample_waits_for_it() -> None:
    state, outputs = play(armed(), (command(0), 0.001))
    assert outputs == []
    _, outputs = play(state, (position(0), 0.002))
    assert outputs[0] == SetVoltage((1.0,))


@pytest.mark.parametrize("seq", [0, 1])
def test_a_repeated_command_does_not_displace_one_that_waits_for_its_sample(
    seq: int,
) -> None:
    before = ((position(0), 0.0), (command(0), 0.004), (command(1, 1.01), 0.020))
    state, outputs = play(armed(), *before, (command(seq, 1.02), 0.021))
    assert (state.refused, fault_text(state.refusal)) == (1, f"command {seq} after 1")
    _, outputs = play(state, (position(1), 0.022))
    assert outputs[0] == SetVoltage((1.01,))


def test_empty_commands_of_a_controller_that_is_not_armed_yet_are_not_refused() -> None:
    unarmed = command(7, epoch=EPOCH - 1).command
    assert unarmed is not None
    nothing = Inputs(None, with_arm(unarmed, valid=False), None)
    state, outputs = play(armed(), (position(0), 0.0), (nothing, 0.004))
    assert (outputs, state.refused, state.refusal) == ([], 0, None)


def test_free_arm_ramps_within_sixty_and_is_safe_within_a_hundred_ms() -> None:
    state = holding(3.0 - 1.0, held=False)
    begun = safe = None
    for inputs, now in wakes(0.005, 0.12):
        state, _ = play(state, (inputs, now))
        if begun is None and state.mode == "ramping":
            begun = now
        if safe is None and state.arms[0].voltage_V == CONFIG.safe_V:
            safe = now
    assert begun is not None
    assert begun <= 0.060
    assert safe is not None
    assert safe <= 0.100
    assert state.mode == "latched"
    assert "no command for" in cause_words(state)


def test_after_a_trip_no_command_is_accepted_until_a_reset() -> None:
    state, _ = play(holding(held=False), *wakes(0.005, 0.12))
    state, _ = play(state, (position(5), 0.122))
    state, outputs = play(state, (command(5, 3.0), 0.124))
    assert outputs == []
    assert (state.arms[0].voltage_V, state.refused) == (0.0, 1)
    with pytest.raises(RefusedError, match="reset it first"):
        handle(CONFIG, state, Arm(12, OWNER, ""), 0.2)
    state, _, _ = handle(CONFIG, state, Reset(acknowledge=True), 0.3)
    assert state.mode == "idle"


@pytest.mark.parametrize("held", [False, True])
def test_an_emergency_stop_acts_at_the_next_wake_up(held: bool) -> None:
    state, _ = play(holding(2.0, held=held), (position(1), 0.005))
    state, reply, published = handle(CONFIG, state, Trip(Cause.ESTOP), 0.006)
    assert reply == Ack(1)
    assert isinstance(published[0], Applied)
    assert (published[0].state, published[0].seq) == ("frozen" if held else "ramping", 1)
    state, outputs = play(state, (WAKE, 0.010))
    assert (state.arms[0].voltage_V < 2.0) is not held
    assert any(isinstance(output, SetVoltage) for output in outputs) is not held


@pytest.mark.parametrize("held", [False, True])
def test_an_actuator_that_is_shut_down_first_ramps_to_the_safe_voltage(held: bool) -> None:
    state, now = holding(2.0, held=held), 0.01
    for _ in range(20):
        assert SERVICE.shutdown is not None
        state, at_rest = SERVICE.shutdown(CONFIG, state, now)
        if at_rest:
            break
        state, _ = play(state, (WAKE, now))
        now += T / 4
    assert state.arms[0].voltage_V == CONFIG.safe_V
    assert now <= 0.01 + CONFIG.ramp_s + T / 4


def test_a_restarted_actuator_ramps_from_the_voltage_it_finds() -> None:
    state = initialize_from_output(CONFIG, start(CONFIG), (2.0,))
    assert (state.mode, state.arms[0].voltage_V) == ("latched", 2.0)
    state, _, _ = handle(CONFIG, state, Trip(Cause.SUPERVISOR), 0.0)
    state, outputs = play(state, (WAKE, 0.0))
    drive = outputs[0]
    assert isinstance(drive, SetVoltage)
    assert 2.0 - drive.voltages_V[0] <= 2.0 * (T / 4) / CONFIG.ramp_s + 1e-9


def test_a_failing_instrument_causes_a_trip() -> None:
    state, _ = play(holding(held=True), (Inputs(OFF, None, None), 0.01))
    assert (state.mode, cause_words(state)) == ("frozen", "device: laser off")


def test_a_tick_without_a_command_is_answered_with_the_present_voltage() -> None:
    state, outputs = play(holding(held=False), (position(1), 0.020), (WAKE, 0.0351))
    applied = outputs[-1]
    assert isinstance(applied, Applied)
    assert (applied.seq, applied.answered, applied.arms[0].voltage_V) == (1, False, 1.0)
    assert state.mode == "armed"


def test_rearming_starts_from_the_applied_voltage() -> None:
    state = holding(1.5, held=False)
    state, _ = play(state, (position(1), 0.02))
    final = Command(EPOCH, 1, OWNER, (ArmCommand(1.5),), False, False, True, True)
    state, _ = play(state, (Inputs(None, final, None), 0.022))
    assert state.mode == "idle"
    state, _, published = handle(CONFIG, state, Arm(12, OWNER, ""), 1.0)
    assert published[0] == with_arm(
        published[0], epoch=12, seq=-1, voltage_V=1.5, state="armed", final=False
    )


@given(st.lists(st.tuples(st.integers(0, 30), st.floats(-20, 20)), max_size=40))
def test_the_voltage_stays_within_its_limits_for_any_command(
    commands: list[tuple[int, float]],
) -> None:
    state, previous = armed(), 0.0
    for index, (seq, voltage_V) in enumerate(commands):
        now = 0.001 * index
        state, _ = play(state, (position(index), now), (command(seq, voltage_V), now))
        assert ARM.voltage.min_V <= state.arms[0].voltage_V <= ARM.voltage.max_V
        assert abs(state.arms[0].voltage_V - previous) <= ARM.voltage.slew_V + 1e-12
        previous = state.arms[0].voltage_V


@given(st.lists(st.tuples(st.floats(0.0, 0.045), st.floats(-1.0, 4.0)), max_size=60))
def test_the_voltage_keeps_its_slew_limit_in_any_pattern_of_commands(
    arrivals: list[tuple[float, float]],
) -> None:
    """Two consecutive voltages differ by no more than the slew limit times the time between
    them."""
    slow = replace(ARM, voltage=replace(ARM.voltage, slew_V=0.2))
    limits = replace(CONFIG, arms=(slow,))
    rate_V_per_s = slow.voltage.slew_V / T
    state, now, moves = armed(limits), 0.0, [(-T, 0.0)]
    for seq, (gap_s, voltage_V) in enumerate(arrivals):
        now += gap_s
        state, _ = step(limits, state, position(seq), now)
        state, _ = step(limits, state, command(seq, voltage_V), now)
        if state.mode != "armed":
            break
        if state.arms[0].voltage_V != moves[-1][1]:
            moves.append((now, state.arms[0].voltage_V))
    for (before_s, before_V), (at_s, at_V) in pairwise(moves):
        assert abs(at_V - before_V) <= rate_V_per_s * (at_s - before_s + 1e-6)
        assert abs(at_V - before_V) <= slow.voltage.slew_V + 1e-12


@given(st.lists(st.integers(0, 12), min_size=1, max_size=60))
def test_of_reordered_and_repeated_commands_only_those_with_increasing_numbers_are_applied(
    seqs: list[int],
) -> None:
    seen = play(armed(), *[(position(seq), 0.0) for seq in range(8)])[0]
    numbers = [seq % 8 for seq in seqs]
    state, outputs = play(seen, *[(command(seq, 0.1 * seq), 0.001) for seq in numbers])
    taken = [output.seq for output in outputs if isinstance(output, Applied)]
    increasing: list[int] = []
    newest = 7
    for seq in numbers:
        fresh = newest - seq <= CONFIG.age.limit_ticks
        if fresh and (not increasing or seq > increasing[-1]):
            increasing.append(seq)
    assert taken == increasing
    assert state.refused == len(numbers) - len(increasing)
