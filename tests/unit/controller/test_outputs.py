"""The hard limits before a command leaves."""

from math import nan

import pytest
from msgspec.structs import replace

from pincette.control.planning.segments import Drive, Ramp, Seek
from pincette.control.safety.monitors import UNSEEN, finding
from pincette.core.codec import decode, encode
from pincette.core.faults import Cause
from pincette.core.messages import Command, Telemetry
from pincette.core.messages.arms import ArmCommand
from pincette.core.wording import named_text
from pincette_controller.outputs import check_command
from pincette_controller.step import Inputs, State, step
from tests.support.arms import with_arm

from .bench import CONFIG, QUIET, Bench, program

COMMAND = Command(
    1, 0, 5, (ArmCommand(0.5, force_mN=1.0, x_d_um=0.0),), True, True, True, valid=True
)
SEEN = with_arm(QUIET, applied_V=0.25)


def test_a_command_within_the_limits_is_sent_unchanged() -> None:
    (watches,), command = check_command(CONFIG.arms, (UNSEEN,), COMMAND, SEEN)
    assert command is COMMAND
    assert watches.seq == 0


def test_a_command_after_a_force_beyond_the_hard_limit_is_invalid_and_has_no_unknown_values() -> (
    None
):
    watches, command = UNSEEN, COMMAND
    for seq in range(3):
        pressing = with_arm(COMMAND, seq=seq, force_mN=60.0)
        (watches,), command = check_command(CONFIG.arms, (watches,), pressing, SEEN)
        assert command.valid is (seq < 2)
    assert named_text(command.fault).startswith("force: 60.0 mN, limit 50.0 mN")
    assert (command.arms[0].voltage_V, command.arms[0].force_mN, command.arms[0].x_d_um) == (
        0.25,
        60.0,
        0.0,
    )
    assert (command.final, command.zero, command.sweep) == (False, False, None)


def test_a_position_beyond_the_hard_limits_makes_the_command_invalid() -> None:
    watches, command = UNSEEN, COMMAND
    for seq in range(3):
        far = with_arm(SEEN, seq=seq, x_um=80.0)
        here = with_arm(COMMAND, seq=seq, x_d_um=None)
        (watches,), command = check_command(CONFIG.arms, (watches,), here, far)
    found = finding(CONFIG.arms[0].monitors, watches)
    assert found is not None
    assert found.cause == Cause.POSITION
    assert not command.valid


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"voltage_V": nan}, "the law: nan V is not a voltage"),
        ({"voltage_V": 1e6}, "the law: 1e+06 V is impossible"),
        ({"x_d_um": nan}, "the law: nan µm is not a position"),
        ({"force_mN": nan}, "the law: nan mN is not a force"),
    ],
)
def test_an_invalid_output_of_a_law_is_not_passed_on(changes: dict[str, float], words: str) -> None:
    odd = with_arm(COMMAND, **changes)
    (watches,), command = check_command(CONFIG.arms, (UNSEEN,), odd, SEEN)
    assert watches is UNSEEN
    assert named_text(command.fault).startswith(words)
    assert (command.valid, command.arms[0].voltage_V) == (False, 0.25)
    assert (command.arms[0].force_mN, command.arms[0].x_d_um) == (None, None)


def test_a_failed_controller_states_why_and_sends_no_more_commands() -> None:
    bench = Bench(program())
    state: State = bench.state
    commands: list[Command] = []
    for seq in range(30):
        x_um = 0.0 if seq < 3 else 15.0 * (-1) ** seq
        estimate = with_arm(QUIET, seq=seq, x_um=x_um, zero_age_s=None)
        state, outputs = step(CONFIG, state, Inputs(estimate), 0.0)
        command = outputs[0]
        assert isinstance(command, Command)
        commands.append(command)
    invalid = [command.seq for command in commands if not command.valid]
    assert invalid == list(range(invalid[0], 30))
    assert 5 <= invalid[0] <= 20
    assert "following_error: the arm is at" in named_text(commands[-1].fault)
    assert state.found == commands[-1].fault
    assert not state.playing


def test_a_command_states_the_lowest_force_that_its_sample_may_have() -> None:
    bench = Bench(program())
    state, outputs = step(CONFIG, bench.state, Inputs(QUIET), 0.0)
    first = outputs[0]
    assert isinstance(first, Command)
    # Before a zero the smallest force that presses: 0 mN minus the uncertainty of 0.1 mN.
    assert (first.arms[0].force_mN, first.arms[0].x_d_um) == (-0.1, None)
    zeroed = with_arm(QUIET, seq=1, zero_age_s=0.1, force_mN=0.5)
    state, outputs = step(CONFIG, state, Inputs(zeroed), 0.0)
    second = outputs[0]
    assert isinstance(second, Command)
    assert second.arms[0].force_mN == 0.5
    assert second.arms[0].x_d_um == pytest.approx(0.0)
    tripped = with_arm(zeroed, seq=2, tripped=True, force_mN=7.0)
    state, outputs = step(CONFIG, state, Inputs(tripped), 0.0)
    blind = outputs[0]
    assert isinstance(blind, Command)
    assert (blind.valid, blind.arms[0].force_mN, blind.arms[0].x_d_um) == (False, 7.0, None)


def test_a_number_that_other_programs_would_reject_is_not_sent_and_ends_the_commands() -> None:
    segments = (
        Seek("contact", 1.0, to_um=(14.0,)),
        Drive("hold", 0.6, courses=(Ramp(0.0),)),
    )
    soft = replace(
        program(),
        segments=segments,
        contact_stiffness_mN_per_um=5e-324,
        contact_line="planned",
    )
    state: State = Bench(soft).state
    received: list[tuple[object, ...]] = []
    for seq in range(80):
        estimate = with_arm(QUIET, seq=seq, zero_age_s=0.1, force_mN=3.0)
        state, outputs = step(CONFIG, state, Inputs(estimate), 0.0)
        for output in outputs:
            assert isinstance(output, Command | Telemetry)
            assert decode(type(output), encode(output)) == output
        received.append(outputs)
    astray = next(outputs for outputs in received if len(outputs) == 1)
    (command,) = astray
    assert isinstance(command, Command)
    assert not command.valid
    assert named_text(command.fault) == "the law: contact_x_um = nan"
    assert command.arms[0].force_mN == 3.0
    assert state.silenced == command.fault
    assert all(len(outputs) == 1 for outputs in received[received.index(astray) :])
