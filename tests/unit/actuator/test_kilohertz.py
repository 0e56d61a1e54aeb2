"""The actuator's guarantees at T = 1 ms, with the limits of the rig file, in virtual time."""

from itertools import pairwise
from pathlib import Path

import pytest

from pincette.config import read_rig
from pincette.core.messages import Command, Position
from pincette.core.messages.arms import ArmCommand, ArmPosition
from pincette.core.service import SetVoltage
from pincette_actuator.config import configure
from pincette_actuator.state import State
from pincette_actuator.step import Inputs, step

from .bench import EPOCH, OWNER, WAKE, armed

RIG = read_rig(Path("deploy/rigs/kilohertz.toml"))
LIMITS = configure(RIG.model_copy(update={"rig": RIG.rig.model_copy(update={"time": "real"})}))
T = LIMITS.period_s
TICKS, HIGHEST_V = 200, 4915 * RIG.output.step_V
WAY_S = 0.65 * T
"""Time from a sample to its command, in s."""
STEP_V = 1e-9
Put = tuple[float, float, str]
"""An output voltage with its time and the mode."""


def run(*, held: bool) -> tuple[State, float]:
    """Play a rise within the slew limit; returns the time of its last sample."""
    state, sample_s = armed(LIMITS), 0.0
    for seq in range(TICKS):
        sample_s = seq * T
        position = Position(EPOCH, seq, sample_s, (ArmPosition(1.0, valid=True),))
        voltage_V = HIGHEST_V * (seq + 1) / TICKS
        command = Command(EPOCH, seq, OWNER, (ArmCommand(voltage_V),), held, False, False, True)
        state, _ = step(LIMITS, state, Inputs(None, None, position), sample_s)
        state, _ = step(LIMITS, state, Inputs(None, command, None), sample_s + WAY_S)
    assert (state.mode, state.arms[0].voltage_V) == ("armed", HIGHEST_V)
    return state, sample_s


def silence(state: State, from_s: float, for_s: float) -> list[Put]:
    """Return the outputs while only the actuator's own timer wakes it."""
    found: list[Put] = []
    for look in range(1, round(for_s / LIMITS.age.wake_s)):
        now = from_s + look * LIMITS.age.wake_s
        state, outputs = step(LIMITS, state, WAKE, now)
        found += [
            (now, one.voltages_V[0], state.mode) for one in outputs if isinstance(one, SetVoltage)
        ]
        found += [(now, state.arms[0].voltage_V, state.mode)]
    return found


@pytest.mark.parametrize("held", [False, True])
def test_a_silence_is_noticed_at_the_age_limit(held: bool) -> None:
    state, sample_s = run(held=held)
    put = silence(state, sample_s + WAY_S, 0.02)
    tripped_s = next(at_s for at_s, _, mode in put if mode != "armed") - sample_s
    assert LIMITS.age.limit_s <= tripped_s <= LIMITS.age.limit_s + LIMITS.age.wake_s
    assert all((mode == "frozen") == held for at_s, _, mode in put if at_s - sample_s > tripped_s)


def test_a_free_arm_reaches_the_safe_voltage_in_time_and_in_small_steps() -> None:
    state, sample_s = run(held=False)
    put = silence(state, sample_s + WAY_S, 0.1)
    over_s = next(at_s for at_s, voltage_V, _ in put if voltage_V == LIMITS.safe_V) - sample_s
    limit_s = LIMITS.age.limit_s + LIMITS.ramp_s + 3.0 * LIMITS.age.wake_s
    assert 0.9 * LIMITS.ramp_s <= over_s <= limit_s
    steps = [abs(later - one) for (_, one, _), (_, later, _) in pairwise(put)]
    assert max(steps) <= HIGHEST_V * LIMITS.age.wake_s / LIMITS.ramp_s * 1.01 + STEP_V
    assert put[-1][1:] == (LIMITS.safe_V, "latched")


def test_a_part_is_held_for_its_time_and_then_released() -> None:
    state, sample_s = run(held=True)
    put = silence(state, sample_s + WAY_S, LIMITS.freeze_s + 0.1)
    kept = [at_s for at_s, voltage_V, _ in put if voltage_V == HIGHEST_V]
    assert kept[-1] - sample_s >= LIMITS.freeze_s
    assert put[-1][1:] == (LIMITS.safe_V, "latched")
