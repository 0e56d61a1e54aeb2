"""Limits of two arms: each has its own range and step."""

import dataclasses
from pathlib import Path

import pytest

from pincette.config import ConfigError, RigFile, parse_rig, read_rig
from pincette.config.reading import laid_over
from pincette.control.safety.confirmation import begun, found
from pincette.control.safety.latch import trip
from pincette.control.safety.second import SecondLimits
from pincette.core.faults import Cause
from pincette.core.messages.second import SecondCommand
from pincette_actuator.config import configure
from pincette_actuator.step import step

from .bench import CONFIG
from .test_two_arms import BOTH, armed, command, of_second, position


def test_each_output_puts_out_multiples_of_its_own_step() -> None:
    steps = dataclasses.replace(
        BOTH,
        voltage=dataclasses.replace(CONFIG.voltage, step_V=0.25),
        second=SecondLimits(dataclasses.replace(CONFIG.voltage, step_V=0.125), CONFIG.monitors),
    )
    state = armed()
    for inputs, now in ((position(0), 0.0), (command(0, 1.1, SecondCommand(1.1)), 0.004)):
        state, _ = step(steps, state, inputs, now)
    assert (state.voltage_V, of_second(state).voltage_V) == (1.0, 1.125)
    back = begun(steps, state, 1.01, 1.13)
    assert (back.voltage_V, of_second(back).voltage_V) == (1.0, 1.125)
    back = found(steps, trip(steps, state, Cause.ESTOP, 0.005), 0.76, 0.006, 0.88)
    assert (back.voltage_V, of_second(back).voltage_V) == (0.75, 0.875)


def rig(*changes: dict[str, object]) -> RigFile:
    tree = read_rig(Path("deploy/rigs/two-arms.toml")).model_dump(exclude_unset=True)
    for change in changes:
        tree = laid_over(tree, change)
    return parse_rig(tree)


def test_limits_of_the_second_arm_are_its_own() -> None:
    made = configure(rig({"second": {"limits": {"voltage_max_V": 3.0}}}))
    assert made.second is not None
    assert (made.voltage.max_V, made.second.voltage.max_V) == (4.0, 3.0)
    made = configure(rig({"second": {"output": {"step_V": 0.0003}}}))
    assert made.second is not None
    assert (made.voltage.step_V, made.second.voltage.step_V) == (0.001220703125, 0.0003)
    with pytest.raises(ConfigError, match=r"safe_V = 0.0 V is outside 0.5..3.0 V of \[second"):
        configure(rig({"second": {"limits": {"voltage_min_V": 0.5, "voltage_max_V": 3.0}}}))
