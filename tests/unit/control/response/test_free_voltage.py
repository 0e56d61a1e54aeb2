"""The inverse free response: its voltage leads to the wanted position."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.control.response.hysteresis import HysteresisModel, displacement_um, start, step
from pincette.control.response.inverse import REACH_V, TOLERANCE_UM, free_voltages

MODEL = HysteresisModel(
    thresholds_V=(0.0, 0.3, 0.6, 1.2),
    weights_um_per_V=(13.7, 5.8, 2.8, -0.6),
    creep_times_s=(0.2, 3.2),
    creep_fractions=(0.018, 0.078),
)
PERIOD_S = 0.02


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.lists(st.floats(-40.0, 60.0), min_size=1, max_size=30))
def test_the_voltages_lead_to_the_requested_displacement(displacements_um: list[float]) -> None:
    state = start(MODEL)
    voltages = free_voltages(MODEL, displacements_um, PERIOD_S)
    assert len(voltages) == len(displacements_um)
    for voltage_V, wanted_um in zip(voltages, displacements_um, strict=True):
        state = step(MODEL, state, voltage_V, PERIOD_S)
        assert displacement_um(MODEL, state) == pytest.approx(wanted_um, abs=1.01 * TOLERANCE_UM)


def test_holding_a_position_against_creep_needs_a_falling_voltage() -> None:
    voltages = free_voltages(MODEL, [20.0] * 500, PERIOD_S)
    assert voltages[0] > voltages[100] > voltages[-1]


def test_forward_and_backward_voltages_differ_by_the_hysteresis() -> None:
    up = [0.3 * k for k in range(100)]
    voltages = free_voltages(MODEL, [*up, *reversed(up)], PERIOD_S)
    assert voltages[50] - voltages[-51] > 0.05


def test_an_unreachable_displacement_uses_the_largest_voltage() -> None:
    saturating = HysteresisModel((0.0,), (10.0,), curvature_um_per_V2=-1.0)
    (voltage_V,) = free_voltages(saturating, [50.0], PERIOD_S)
    assert abs(voltage_V) > 0.25 * REACH_V
