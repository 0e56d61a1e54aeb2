"""The hard limits in the service: replies, commands to the instrument, and watchdog feeding."""

from math import nan

import pytest

from pincette.control.record import replace
from pincette.core.faults import Cause
from pincette.core.messages import (
    Applied,
    Command,
    Message,
    Position,
    Reset,
    StatusRequest,
    Trip,
)
from pincette.core.messages.arms import ArmCommand, ArmPosition
from pincette.core.service import DeviceCommand, PutOut, RefusedError, SetVoltage
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
    armed,
    cause_words,
    command,
    holding,
    play,
    position,
)

LOCKSTEP = replace(CONFIG, lockstep=True)


def told(seq: int, **changes: object) -> Inputs:
    """Return a command that contains information on its sample."""
    good = Command(EPOCH, seq, OWNER, (ArmCommand(1.0),), False, False, False, True)
    return Inputs(None, with_arm(good, **changes), None)


def ticks(
    state: State, seqs: range, **changes: object
) -> tuple[State, list[Message | DeviceCommand]]:
    events: list[tuple[Inputs, float]] = []
    for seq in seqs:
        events += [(position(seq), seq * T), (told(seq, **changes), seq * T + 0.004)]
    return play(state, *events)


@pytest.mark.parametrize("held", [False, True])
def test_a_force_beyond_the_hard_limit_releases_in_the_same_cycle(held: bool) -> None:
    state, outputs = ticks(holding(held=held), range(1, 4), force_mN=55.0, part_held=held)
    assert (state.mode, state.cause) == ("ramping", "force")
    drive, echo = outputs[-2:]
    assert isinstance(drive, SetVoltage)
    assert 0.0 < drive.voltages_V[0] < 1.0
    assert isinstance(echo, Applied)
    assert (echo.seq, echo.state, echo.answered) == (3, "ramping", False)
    assert "55.0 mN, limit 50.0 mN" in cause_words(echo)


def test_in_lockstep_the_trip_ends_its_tick() -> None:
    state = armed()
    for seq in range(3):
        state, _ = step(LOCKSTEP, state, position(seq), seq * T)
        state, outputs = step(LOCKSTEP, state, told(seq, force_mN=55.0), seq * T)
        assert isinstance(outputs[0], SetVoltage)
        echo = outputs[1]
        assert isinstance(echo, Applied)
        assert (echo.seq, echo.answered) == (seq, seq < 2)
    assert state.mode == "ramping"


def test_in_lockstep_an_invalid_command_also_ends_its_tick() -> None:
    state, _ = step(LOCKSTEP, armed(), position(0), 0.0)
    state, outputs = step(LOCKSTEP, state, told(0, voltage_V=nan), 0.0)
    assert outputs[0] == SetVoltage((0.0,))
    assert (state.refused, state.mode) == (1, "armed")


def test_in_lockstep_an_unauthorized_command_does_not_end_the_tick() -> None:
    state, _ = step(LOCKSTEP, armed(), position(0), 0.0)
    state, outputs = step(LOCKSTEP, state, told(0, owner=OWNER + 1), 0.0)
    assert (outputs, state.refused) == ((), 1)


@pytest.mark.parametrize(("held", "mode"), [(False, "ramping"), (True, "frozen")])
def test_a_position_beyond_the_limits_trips_before_its_command_arrives(
    held: bool, mode: str
) -> None:
    events: list[tuple[Inputs, float]] = []
    for seq in (1, 2, 3):
        seen = Position(EPOCH, seq, seq * T, (ArmPosition(80.0, valid=True),))
        events.append((Inputs(None, None, seen), seq * T))
        if seq < 3:
            events.append((command(seq, held=held), seq * T + 0.004))
    state, outputs = play(holding(held=held), *events)
    assert (state.mode, state.cause) == (mode, "position")
    echo = outputs[-1]
    assert isinstance(echo, Applied)
    assert (echo.seq, echo.state) == (3, mode)


def test_an_unauthorized_sender_does_not_displace_a_waiting_command() -> None:
    state, _ = play(armed(), (told(0), 0.001), (told(0, owner=9, voltage_V=3.0), 0.0015))
    assert state.pending is not None
    state, outputs = play(state, (position(0), 0.002))
    assert outputs[0] == SetVoltage((1.0,))
    assert (state.refused, state.taken_seq) == (1, 0)


def test_a_command_that_arrives_with_the_sample_does_not_prevent_the_trip() -> None:
    state, _ = play(armed(), (told(0), 0.001))
    both = replace(told(0, owner=9, voltage_V=3.0), position=position(0).position)
    _, outputs = play(state, (both, 0.002))
    assert outputs[0] == SetVoltage((1.0,))


def test_a_command_waiting_at_the_trip_is_refused_when_its_sample_arrives() -> None:
    state, _ = play(holding(held=False), (told(1), 0.019))
    state, _, _ = handle(CONFIG, state, Trip(Cause.ESTOP), 0.0195)
    assert state.pending is not None
    state, outputs = play(state, (position(1), 0.020))
    assert (state.pending, state.refused, state.mode) == (None, 1, "ramping")
    assert not any(isinstance(output, Applied) and output.answered for output in outputs)


@pytest.mark.parametrize("trips", ["before", "between"])
def test_in_lockstep_a_command_before_its_sample_ends_the_tick_after_a_trip(trips: str) -> None:
    state = holding(held=True)
    if trips == "before":
        state, _, _ = handle(LOCKSTEP, state, Trip(Cause.ABORT), 0.02)
    state, outputs = step(LOCKSTEP, state, told(1), 0.02)
    assert outputs == ()
    if trips == "between":
        state, _, _ = handle(LOCKSTEP, state, Trip(Cause.ABORT), 0.02)
    state, outputs = step(LOCKSTEP, state, position(1), 0.02)
    order, echo = outputs
    assert order == SetVoltage((state.arms[0].voltage_V,))
    assert isinstance(echo, Applied)
    assert (echo.seq, echo.state, echo.answered) == (1, "frozen", False)


def test_an_unsupported_request_is_refused() -> None:
    with pytest.raises(RefusedError, match="does not answer StatusRequest"):
        handle(CONFIG, armed(), StatusRequest(), 0.0)


def may_kick_watchdog(state: State, now: float) -> bool:
    assert SERVICE.may_kick_watchdog is not None
    return SERVICE.may_kick_watchdog(CONFIG, state, now)


def test_the_watchdog_is_not_fed_during_an_unconfirmed_ramp() -> None:
    fault = Inputs(OFF, None, None)
    state, _ = play(holding(held=False), (fault, 0.01))
    assert (state.mode, state.unconfirmed) == ("ramping", True)
    assert not may_kick_watchdog(state, 0.015)
    state, outputs = play(state, (WAKE, 0.015))
    assert outputs == [], "no voltage may be written before the output has reported its own"
    state, _ = play(state, (Inputs(PutOut((1.0,)), None, None), 0.015))
    assert not may_kick_watchdog(state, 0.015)
    state, outputs = play(state, (WAKE, 0.016))
    assert isinstance(outputs[0], SetVoltage)
    assert may_kick_watchdog(state, 0.02)
    state, _ = play(state, (fault, 0.016))
    assert not may_kick_watchdog(state, 0.02)


def test_a_frozen_part_is_kept_by_heartbeats_after_an_unconfirmed_write() -> None:
    state, outputs = play(holding(held=True), (Inputs(OFF, None, None), 0.01))
    assert (state.mode, state.unconfirmed) == ("frozen", True)
    assert not any(isinstance(output, SetVoltage) for output in outputs)
    assert may_kick_watchdog(state, 0.5)


def test_a_reset_retries_the_output() -> None:
    state, _ = play(holding(held=True), (Inputs(OFF, None, None), 0.01))
    state, _, _ = handle(CONFIG, state, Reset(acknowledge=True), 0.1)
    assert not state.unconfirmed
    assert may_kick_watchdog(state, 9.0)
