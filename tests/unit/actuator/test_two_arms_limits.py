"""Limits of two arms: each has its own range and step."""

import dataclasses
from pathlib import Path

import pytest
from msgspec.structs import replace

from pincette.config import ConfigError, RigFile, parse_rig, read_rig
from pincette.config.reading import laid_over
from pincette.control.safety.arm import ArmOutput
from pincette.control.safety.confirmation import begun, found
from pincette.control.safety.latch import trip
from pincette.control.safety.monitors import UNSEEN
from pincette.core.faults import Cause, Mode
from pincette.core.messages import Arm
from pincette.core.messages.arms import ArmCommand
from pincette_actuator.config import configure
from pincette_actuator.requests import handle
from pincette_actuator.step import start, step

from .bench import ARM, EPOCH, OWNER
from .test_two_arms import BOTH, armed, at, command, position


def test_each_output_uses_multiples_of_its_own_step() -> None:
    steps = dataclasses.replace(
        BOTH,
        arms=tuple(
            dataclasses.replace(ARM, voltage=dataclasses.replace(ARM.voltage, step_V=step_V))
            for step_V in (0.25, 0.125)
        ),
    )
    state = armed()
    for inputs, now in ((position(0), 0.0), (command(0, 1.1, ArmCommand(1.1)), 0.004)):
        state, _ = step(steps, state, inputs, now)
    assert (state.arms[0].voltage_V, state.arms[1].voltage_V) == (1.0, 1.125)
    back = begun(steps, state, (1.01, 1.13))
    assert (back.arms[0].voltage_V, back.arms[1].voltage_V) == (1.0, 1.125)
    back = found(steps, trip(steps, state, Cause.ESTOP, 0.005), (0.76, 0.88), 0.006)
    assert (back.arms[0].voltage_V, back.arms[1].voltage_V) == (0.75, 0.875)


@pytest.mark.parametrize(
    ("safe_V", "found_V", "second_V", "held"),
    [(0.0, 0.4, 2.0, False), (0.0, 1.0, 1.0, True), (0.5, 1.0, 1.0, False)],
    ids=["the first alone", "as near to both", "from a safe voltage that is not 0 V"],
)
def test_a_part_counts_as_released_if_either_output_has_released(
    safe_V: float, found_V: float, second_V: float, held: bool
) -> None:
    limits = dataclasses.replace(BOTH, safe_V=safe_V)
    assert begun(limits, at(1.0, 2.0, held=True), (found_V, second_V)).part_held == held


def test_an_impossible_voltage_of_the_first_arm_is_refused_despite_a_valid_second_one() -> None:
    state = armed()
    for inputs, now in ((position(0), 0.0), (command(0, 1e6, ArmCommand(1.0)), 0.004)):
        state, _ = step(BOTH, state, inputs, now)
    assert (state.arms[0].voltage_V, state.arms[1].voltage_V, state.refused) == (0.0, 0.0, 1)


def test_an_arming_resets_the_observations_of_the_second_arm() -> None:
    state = replace(at(1.0, 2.0), mode=Mode.IDLE)
    assert state.arms[1].watches != UNSEEN
    again, _, _ = handle(BOTH, state, Arm(EPOCH + 1, OWNER, ""), 1.0)
    assert again.arms[1] == ArmOutput(2.0)


def rig(*changes: dict[str, object]) -> RigFile:
    tree = read_rig(Path("deploy/rigs/two-arms.toml")).model_dump(exclude_unset=True)
    for change in changes:
        tree = laid_over(tree, change)
    return parse_rig(tree)


def test_the_second_arm_has_its_own_limits() -> None:
    made = configure(rig({"second": {"limits": {"voltage_max_V": 3.0}}}))
    first, second = made.arms
    assert (first.voltage.max_V, second.voltage.max_V) == (4.0, 3.0)
    assert first.monitors == second.monitors
    made = configure(rig({"second": {"output": {"step_V": 0.0003}}}))
    assert [arm.voltage.step_V for arm in made.arms] == [0.001220703125, 0.0003]
    with pytest.raises(ConfigError, match=r"safe_V = 0.0 V is outside 0.5..3.0 V of \[second"):
        configure(rig({"second": {"limits": {"voltage_min_V": 0.5, "voltage_max_V": 3.0}}}))


@pytest.mark.parametrize("end", ["voltage_min_V", "voltage_max_V"])
def test_a_safe_voltage_may_be_at_the_end_of_the_second_range(end: str) -> None:
    made = configure(rig({"safety": {"safe_V": 0.5}, "second": {"limits": {end: 0.5}}}))
    assert made.safe_V == start(made).arms[0].voltage_V == 0.5
