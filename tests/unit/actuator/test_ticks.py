"""A tick without a command has one echo, and a voltage is written only if one is due."""

import pytest

from pincette.control.record import replace
from pincette.core.faults import Cause, Mode
from pincette.core.idle_sampling import SAMPLE_S
from pincette.core.messages import Ack, Applied, Arm, Command
from pincette.core.messages.arms import ArmApplied, ArmCommand
from pincette.core.service import CheckWave, SetVoltage
from pincette.core.wording import fault_text
from pincette_actuator.requests import handle
from pincette_actuator.state import State
from pincette_actuator.step import SERVICE, Inputs, step
from tests.support.arms import with_arm

from .bench import (
    CONFIG,
    EPOCH,
    OFF,
    OWNER,
    WAKE,
    T,
    cause_words,
    command,
    holding,
    play,
    position,
)
from .test_sweep import swept

UNASKED_S = 0.036
"""Time at which the sample of 0.02 s has waited for a command long enough, in s."""


def stood(mode: str) -> State:
    return replace(
        holding(held=True),
        mode=mode,
        cause="estop",
        since_s=0.02,
        ran_s=0.03,
        unconfirmed=True,
        located=True,
    )


@pytest.mark.parametrize(
    ("mode", "ordered"), [("idle", False), ("frozen", False), ("latched", True)]
)
def test_a_tick_without_a_command_is_answered_once_and_writes_the_voltage_only_in_the_latch(
    mode: str, ordered: bool
) -> None:
    state, outputs = play(stood(mode), (position(1), 0.02), (WAKE, UNASKED_S))
    assert [isinstance(output, SetVoltage) for output in outputs] == [True, False][not ordered :]
    echo = outputs[-1]
    assert isinstance(echo, Applied)
    assert (echo.seq, echo.state, echo.answered, echo.command_age_s) == (1, mode, False, 0.0)
    assert state.answered_seq == 1
    assert state.unconfirmed == (not ordered)
    again, outputs = play(state, (WAKE, UNASKED_S + 0.005))
    assert outputs == []
    assert again.mode == mode


def test_at_rest_a_tick_is_answered_at_once_even_after_a_missed_one() -> None:
    _, outputs = play(stood("idle"), (position(1), 0.02), (position(6), 0.12), (WAKE, 0.2))
    assert [one.seq for one in outputs if isinstance(one, Applied)] == [1, 5, 6]


def test_at_rest_the_clock_is_checked_seldom_unless_a_read_back_is_due() -> None:
    assert SERVICE.timer_s is not None
    armed = holding(held=False)
    unknown = replace(armed, mode="latched", unconfirmed=True, located=False)
    for state in (armed, unknown):
        assert SERVICE.timer_s(CONFIG, state) == CONFIG.age.wake_s
    for mode in ("idle", "latched"):
        assert SERVICE.timer_s(CONFIG, replace(armed, mode=mode)) == SAMPLE_S


def test_a_tick_is_not_answered_before_its_time() -> None:
    state, outputs = play(holding(held=False), (position(1), 0.02), (WAKE, 0.0349))
    assert outputs == []
    _, outputs = play(state, (WAKE, 0.0351))
    assert len(outputs) == 2


def test_a_tick_is_answered_at_its_time_exactly() -> None:
    _, outputs = play(holding(held=False), (position(1), 0.005), (WAKE, 0.005 + 0.75 * T))
    assert len(outputs) == 2


def test_in_lockstep_no_time_passes_between_sample_and_command() -> None:
    silent = replace(holding(held=False), fresh_s=-9.0)
    state, outputs = step(replace(CONFIG, lockstep=True), silent, position(1), 0.02)
    assert (outputs, state.mode) == ((), "armed")


def test_without_a_sample_there_is_no_tick() -> None:
    _, outputs = play(replace(holding(held=False), mode=Mode.IDLE, arrivals=()), (WAKE, 9.0))
    assert outputs == []


def test_an_invalid_command_answers_its_tick_at_once_and_only_once() -> None:
    blind = Command(EPOCH, 1, OWNER, (ArmCommand(0.0),), False, False, False, False, OFF)
    state, outputs = play(
        holding(held=False), (position(1), 0.02), (Inputs(None, blind, None), 0.024)
    )
    assert [type(output) for output in outputs] == [SetVoltage, Applied]
    _, outputs = play(state, (Inputs(None, blind, None), 0.025))
    assert outputs == []


def test_an_accepted_command_is_reported_with_its_age_and_flags() -> None:
    requested = with_arm(
        Command(EPOCH, 1, OWNER, (ArmCommand(1.5),), True, True, True, True),
        x_d_um=1.0,
        force_mN=2.0,
    )
    doubted = replace(holding(held=False), unconfirmed=True)
    state, outputs = play(doubted, (position(1), 0.02), (Inputs(None, requested, None), 0.024))
    assert outputs == [
        SetVoltage((1.5,)),
        Applied(
            epoch=EPOCH,
            seq=1,
            arms=(ArmApplied(1.5, 0),),
            state=Mode.IDLE,
            cause=Cause.NONE,
            part_held=True,
            zero=True,
            final=True,
            answered=True,
            refused=0,
            command_age_s=0.024 - 0.02,
            slewing_s=T,
        ),
    ]
    assert (state.answered_seq, state.unconfirmed, state.pending) == (1, False, None)
    assert (state.arms[0].watches.aim_um, state.arms[0].watches.seq) == (1.0, 1)


def test_an_interrupted_sweep_leaves_the_output_unconfirmed() -> None:
    state, outputs = play(holding(held=False), (position(1), 0.02), (swept(1), 0.024))
    assert state.unconfirmed is False
    state, outputs = play(state, (position(2), 0.04), (swept(2), 0.044))
    assert isinstance(outputs[0], CheckWave)
    state, outputs = play(state, (Inputs(OFF, None, None), 0.045))
    assert (state.mode, state.sweep, state.unconfirmed) == ("ramping", None, True)
    assert cause_words(state) == "device: laser off"


def test_a_final_command_with_a_sweep_does_not_start_the_sweep() -> None:
    last = swept(1).command
    assert last is not None
    final = Inputs(None, replace(last, final=True), None)
    state, outputs = play(holding(held=False), (position(1), 0.02), (final, 0.024))
    assert (state.mode, state.sweep) == ("idle", None)
    assert outputs[0] == SetVoltage((1.0,))


def test_an_arming_resets_the_state_of_the_previous_arming() -> None:
    left = swept(1).command
    assert left is not None
    idle = replace(
        holding(held=True), mode=Mode.IDLE, pending=left, sweep=left.sweep, answered_seq=7
    )
    state, reply, (echo,) = handle(CONFIG, idle, Arm(EPOCH + 1, OWNER + 1, ""), 1.0)
    assert (state.pending, state.sweep, state.answered_seq) == (None, None, -1)
    assert (state.epoch, state.owner, state.fresh_s) == (EPOCH + 1, OWNER + 1, 2.0)
    assert reply == Ack(-1)
    assert isinstance(echo, Applied)
    assert (echo.seq, echo.epoch, echo.state) == (-1, EPOCH + 1, "armed")


def test_a_command_of_another_owner_is_refused_with_both_owners() -> None:
    state, _ = play(holding(held=False), (command(0, owner=9), 0.01))
    assert fault_text(state.refusal) == "command of owner 9, armed for 5"


def test_the_age_limits_are_those_of_the_configuration() -> None:
    late = (position(1), 0.02), (command(1), 0.02 + CONFIG.age.limit_s + 0.001)
    state, _ = play(replace(holding(held=False), ran_s=0.069), *late)
    assert state.taken_seq == 0


def test_a_tick_with_a_lost_sample_is_answered_with_the_present_voltage() -> None:
    state = holding(1.0, held=False)
    newest = state.arrivals[-1].seq
    at_s = state.arrivals[-1].at_s
    _, outputs = play(state, (position(newest + 2), at_s + 2 * T))
    (echo,) = [item for item in outputs if isinstance(item, Applied)]
    assert (echo.seq, echo.arms[0].voltage_V, echo.answered) == (newest + 1, 1.0, False)
    _, outputs = play(state, (position(newest + 1), at_s + T))
    assert outputs == []
