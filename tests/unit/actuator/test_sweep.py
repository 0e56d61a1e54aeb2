"""A sweep at the actuator: started once, monitored, ended by a voltage or a trip."""

import pytest
from msgspec.structs import replace

from pincette.control.planning.sweep import Sweep
from pincette.control.planning.swept_voltages import SweptVoltages
from pincette.core.faults import Cause
from pincette.core.messages import Applied, Trip
from pincette.core.service import CheckWave, SetVoltage, Wave
from pincette.core.wording import fault_text
from pincette_actuator.requests import handle
from pincette_actuator.step import Inputs

from .bench import CONFIG, WAKE, armed, command, holding, play, position

SWEEP = Sweep(5.0, 400.0, 1.0, 0.05, 4_000.0)


def swept(seq: int, voltage_V: float = 1.0, sweep: Sweep = SWEEP) -> Inputs:
    plain = command(seq, voltage_V).command
    assert plain is not None
    return Inputs(None, replace(plain, sweep=sweep), None)


def test_a_sweep_starts_once_and_is_monitored() -> None:
    state, outputs = play(
        holding(held=False),
        *((position(seq), 0.02 * seq) for seq in (1,)),
        (swept(1), 0.024),
        (position(2), 0.04),
        (swept(2), 0.044),
        (position(3), 0.06),
        (command(3), 0.064),
    )
    orders = [output for output in outputs if not isinstance(output, Applied)]
    assert orders == [Wave(SweptVoltages(SWEEP, 1.0), 4_000.0), CheckWave(), SetVoltage((1.0,))]
    assert state.sweep is None


@pytest.mark.parametrize(
    ("voltage_V", "sweep", "words"),
    [
        (1.0, replace(SWEEP, amplitude_V=0.2), "sweep of ±0.2 V, limit ±0.1 V"),
        (3.98, SWEEP, "sweep from 3.930 V to 4.030 V, limits -1.0 V and 4.0 V"),
        (-0.97, SWEEP, "sweep from -1.020 V to -0.920 V"),
    ],
)
def test_a_sweep_beyond_the_limits_is_refused(voltage_V: float, sweep: Sweep, words: str) -> None:
    state, outputs = play(armed(), (position(0), 0.0), (swept(0, voltage_V, sweep), 0.004))
    assert outputs == []
    assert words in fault_text(state.refusal)


def test_a_tick_without_a_command_lets_the_sweep_continue() -> None:
    state, _ = play(holding(held=False), (position(1), 0.02), (swept(1), 0.024))
    state, outputs = play(state, (position(2), 0.04), (WAKE, 0.056))
    assert isinstance(outputs[0], CheckWave)
    assert state.sweep == SWEEP


def test_a_trip_ends_the_sweep_by_the_ramp() -> None:
    state, _ = play(holding(held=False), (position(1), 0.02), (swept(1), 0.024))
    state, _, _ = handle(CONFIG, state, Trip(Cause.ESTOP), 0.03)
    assert (state.mode, state.sweep) == ("ramping", None)
    _, outputs = play(state, (WAKE, 0.035))
    assert isinstance(outputs[0], SetVoltage)
    assert 0.0 < outputs[0].voltages_V[0] < 1.0
