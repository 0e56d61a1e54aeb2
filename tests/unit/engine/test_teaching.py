"""The free motion that calibrates a simulated rig, and its result."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.config import read_rig
from pincette.control.response.hysteresis import displacement_um, start, step
from pincette.engine.teaching import free_range_um, teach, without_part

DEMO = Path(__file__).parents[3] / "deploy/rigs/demo.toml"


def test_the_motion_covers_the_softest_part_within_the_limits() -> None:
    rig = read_rig(DEMO)
    low_um, high_um = free_range_um(rig)
    assert high_um == pytest.approx(33.0 + 20.0 / (0.7 * 2.17) + 0.46 * 20.0)
    assert low_um == pytest.approx(-0.1 * high_um)
    tight = rig.model_copy(
        update={
            "limits": rig.limits.model_copy(
                update={"position_min_um": -1.0, "position_max_um": 40.0}
            )
        }
    )
    assert free_range_um(tight) == (-1.0, 40.0)


def test_a_response_is_identified_without_a_part_and_without_an_earlier_model() -> None:
    rig = read_rig(DEMO)
    bare = without_part(rig)
    assert bare.simulation is not None
    assert (bare.simulation.bead, bare.lockstep) == (False, True)
    assert (bare.model.free_response, bare.model.recorded_response) == (None, None)
    assert bare.model.compliance_um_per_mN == rig.model.compliance_um_per_mN


@given(voltages=st.lists(st.floats(-1.0, 4.0), min_size=1, max_size=20), up=st.booleans())
def test_the_taught_model_rises_with_the_voltage_whatever_happened_before(
    voltages: list[float], up: bool
) -> None:
    taught = read_rig(DEMO).model.free_response
    assert taught is not None
    model = taught.hysteresis()
    state = start(model)
    for voltage in voltages:
        state = step(model, state, voltage, 0.02)
    way_V = 0.01 if up else -0.01
    # Neither has creep: both rest for no time.
    before_um = displacement_um(model, step(model, state, state.voltage_V, 0.0))
    after_um = displacement_um(model, step(model, state, state.voltage_V + way_V, 0.0))
    assert (after_um - before_um) / way_V > 5.0


def test_a_rig_without_a_simulation_is_refused() -> None:
    rig = read_rig(DEMO)
    with pytest.raises(ValueError, match="simulation"):
        teach(rig.model_copy(update={"simulation": None}))
