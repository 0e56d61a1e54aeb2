"""Readings and voltages within the batch have the digits that the instruments' texts have."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.config import Simulation
from pincette.sim.instruments.keyence_commands import value
from pincette.sim.plant.drive import quantised_V
from pincette.sim.rig.sensor_view import reading_um as viewed_um
from pincette_batch.kernel.instruments import arm_um, put_out_V, reading_um, rounded
from pincette_batch.prepared import prepare_rig
from tests.support.rigs import demo_rig


def simulation_of_demo() -> Simulation:
    simulation = demo_rig().simulation
    assert simulation is not None
    return simulation


@given(st.floats(-10.0, 10.0))
def test_a_voltage_is_rounded_as_its_text(voltage_V: float) -> None:
    assert rounded(voltage_V, 1000.0) / 1000.0 == float(f"{voltage_V:+07.3f}")


@pytest.mark.parametrize("half", [0.0005, 1.0005, 2.5005, -0.0015, -3.4445, 0.0625, 0.1875])
def test_next_to_a_tie_the_number_itself_decides(half: float) -> None:
    for voltage_V in (half, np.nextafter(half, 9.0).item(), np.nextafter(half, -9.0).item()):
        assert rounded(voltage_V, 1000.0) / 1000.0 == float(f"{voltage_V:+07.3f}")


@pytest.mark.parametrize("unit", ["um", "mm"])
def test_a_reading_is_that_of_the_driver(unit: str) -> None:
    rig = demo_rig({"sensor": {"options": {"unit": unit}, "offset_um": 2.5, "direction": -1}})
    prepared, simulation = prepare_rig(rig), simulation_of_demo()
    per_unit = {"um": 1.0, "mm": 1000.0}[unit]
    for x_um, noise in zip(np.linspace(-20.0, 60.0, 997).tolist(), [0.3, -1.2] * 499, strict=False):
        drawn = noise
        shown_um = viewed_um(simulation, x_um, 0.0, lambda _index, drawn=drawn: drawn, 0)
        text = value(shown_um, "mm" if unit == "mm" else "um")
        found_um = reading_um(prepared.bench, x_um, 0.0, noise)
        assert found_um == float(text) * per_unit
        assert arm_um(prepared.bench, found_um) == -(found_um - 2.5)


def test_a_voltage_arrives_in_steps_of_the_output() -> None:
    prepared = prepare_rig(demo_rig())
    for voltage_V in np.linspace(-1.0, 4.0, 501).tolist():
        sent_V = float(f"{voltage_V:+07.3f}")
        assert put_out_V(prepared.bench, voltage_V) == quantised_V(prepared.parameters, sent_V)
