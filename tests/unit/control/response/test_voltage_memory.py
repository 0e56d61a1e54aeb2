"""The history of a voltage as few segments, and a model that is replayed through it."""

from math import pi, sin

import numpy as np
import pytest

from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.identified_response import identified_response
from pincette.control.response.voltage_memory import MOST_PIECES, SMALL_V, Piece, VoltageMemory

T = 0.02
MODEL = identified_response(
    HysteresisModel(
        thresholds_V=(0.0, 0.3, 0.8),
        weights_um_per_V=(12.0, 4.0, 3.0),
        creep_times_s=(0.5, 5.0),
        creep_fractions=(0.02, 0.03),
    ),
    19.0,
    0.05,
)


def remembered(voltages_V: list[float]) -> VoltageMemory:
    memory = VoltageMemory()
    for voltage_V in voltages_V:
        memory = memory.updated(voltage_V, T)
    return memory


def ramp(*to_V: float, rest: int = 0) -> list[float]:
    """Return voltages from 0 V to each value in turn, 0.04 V per sample, with a rest at each."""
    path: list[float] = [0.0]
    for value in to_V:
        count = max(1, round(abs(value - path[-1]) / 0.04))
        path += [*np.linspace(path[-1], value, count + 1).tolist()[1:], *[value] * rest]
    return path


def test_a_ramp_and_the_rest_after_it_are_stored_as_one_piece() -> None:
    (piece,) = remembered([0.5, 1.0, 1.5, 1.5, 1.5]).path
    assert piece == pytest.approx(Piece(1.5, 3 * T, 2 * T))


def test_turning_points_are_stored_except_small_ones() -> None:
    wander = [2.0 + 0.4 * SMALL_V * (-1) ** count for count in range(200)]
    pieces = remembered([*ramp(1.0, 0.5, 2.0), *wander, 1.0]).path
    assert [piece.to_V for piece in pieces] == pytest.approx([0.0, 1.0, 0.5, 2.0, 1.0], abs=0.01)


def test_a_new_model_is_initialized_with_the_stored_voltages() -> None:
    path = [*ramp(1.5, -0.5, 2.5, 0.4, 1.9, rest=25), *ramp(1.9)]
    path += [1.9 + 0.3 * sin(2.0 * pi * 0.5 * T * count) for count in range(400)]
    live = MODEL
    for voltage_V in path:
        live = live.updated(voltage_V, T)
    led = remembered(path).replayed(MODEL).updated(path[-1], 0.0)
    travelled_um = abs(live.position_um())
    assert travelled_um > 20.0
    assert led.position_um() == pytest.approx(live.position_um(), abs=0.1)
    # The continuation equals that of the live model: the turning points are the same.
    for voltage_V in ramp(0.7, 2.2):
        live, led = live.updated(voltage_V, T), led.updated(voltage_V, T)
        assert led.position_um() == pytest.approx(live.position_um(), abs=0.15)


def test_the_distant_past_is_forgotten() -> None:
    memory = remembered([0.5 * (-1) ** count for count in range(3 * MOST_PIECES)])
    assert len(memory.path) == MOST_PIECES
