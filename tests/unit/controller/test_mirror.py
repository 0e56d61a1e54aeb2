"""The hard limits before a command leaves."""

from dataclasses import replace
from math import nan

import pytest

from pincette.control.safety.monitors import UNSEEN, finding
from pincette.messages import Command
from pincette_controller.mirror import mirrored
from pincette_controller.step import Inputs, State, step

from .bench import CONFIG, QUIET, Bench, program

COMMAND = Command(1, 0, 5, 0.5, True, True, True, valid=True, force_mN=1.0, x_d_um=0.0)
SEEN = replace(QUIET, applied_V=0.25)


def test_a_command_within_the_limits_leaves_as_it_is() -> None:
    watches, command = mirrored(CONFIG.monitors, CONFIG.voltage, UNSEEN, COMMAND, SEEN)
    assert command is COMMAND
    assert watches.seq == 0


def test_a_force_beyond_the_hard_limit_leaves_no_command_but_what_is_known() -> None:
    watches, command = UNSEEN, COMMAND
    for seq in range(3):
        pressing = replace(COMMAND, seq=seq, force_mN=60.0)
        watches, command = mirrored(CONFIG.monitors, CONFIG.voltage, watches, pressing, SEEN)
        assert command.valid is (seq < 2)
    assert command.fault.startswith("force: 60.0 mN, limit 50.0 mN")
    assert (command.voltage_V, command.force_mN, command.x_d_um) == (0.25, 60.0, 0.0)
    assert (command.final, command.zero, command.sweep) == (False, False, None)


def test_a_position_beyond_the_hard_limits_leaves_no_command() -> None:
    watches, command = UNSEEN, COMMAND
    for seq in range(3):
        far = replace(SEEN, seq=seq, x_um=80.0)
        here = replace(COMMAND, seq=seq, x_d_um=None)
        watches, command = mirrored(CONFIG.monitors, CONFIG.voltage, watches, here, far)
    assert finding(CONFIG.monitors, watches).startswith("position: ")
    assert not command.valid


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"voltage_V": nan}, "the law: nan V is no voltage"),
        ({"voltage_V": 1e6}, "the law: 1e+06 V is absurd"),
        ({"x_d_um": nan}, "the law: nan µm is no position"),
        ({"force_mN": nan}, "the law: nan mN is no force"),
    ],
)
def test_a_law_that_makes_nonsense_is_not_passed_on(changes: dict[str, float], words: str) -> None:
    odd = replace(COMMAND, **changes)
    watches, command = mirrored(CONFIG.monitors, CONFIG.voltage, UNSEEN, odd, SEEN)
    assert watches is UNSEEN
    assert command.fault.startswith(words)
    assert (command.valid, command.voltage_V) == (False, 0.25)
    assert (command.force_mN, command.x_d_um) == (None, None)


def test_a_controller_that_has_gone_astray_says_why_and_commands_no_more() -> None:
    bench = Bench(program())
    state: State = bench.state
    commands: list[Command] = []
    for seq in range(30):
        x_um = 0.0 if seq < 3 else 15.0 * (-1) ** seq
        estimate = replace(QUIET, seq=seq, x_um=x_um, zero_age_s=None)
        state, outputs = step(CONFIG, state, Inputs(estimate), 0.0)
        command = outputs[0]
        assert isinstance(command, Command)
        commands.append(command)
    invalid = [command.seq for command in commands if not command.valid]
    assert invalid == list(range(invalid[0], 30))
    assert 5 <= invalid[0] <= 20
    assert "following_error: the arm is at" in commands[-1].fault
    assert state.detail == commands[-1].fault
    assert not state.playing


def test_what_a_command_knows_of_its_sample() -> None:
    bench = Bench(program())
    state, outputs = step(CONFIG, bench.state, Inputs(QUIET), 0.0)
    first = outputs[0]
    assert isinstance(first, Command)
    assert (first.force_mN, first.x_d_um) == (None, None)
    zeroed = replace(QUIET, seq=1, zero_age_s=0.1, force_mN=0.5)
    state, outputs = step(CONFIG, state, Inputs(zeroed), 0.0)
    second = outputs[0]
    assert isinstance(second, Command)
    assert second.force_mN == 0.5
    assert second.x_d_um == pytest.approx(0.0)
    tripped = replace(zeroed, seq=2, tripped=True, force_mN=7.0)
    state, outputs = step(CONFIG, state, Inputs(tripped), 0.0)
    blind = outputs[0]
    assert isinstance(blind, Command)
    assert (blind.valid, blind.force_mN, blind.x_d_um) == (False, 7.0, None)
