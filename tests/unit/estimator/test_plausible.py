"""Finite but impossible numbers of a sensor or an output are refused and leave no trace."""

from math import inf, nan

import pytest

from pincette.core.wording import fault_text
from pincette_estimator.config import EstimatorConfig, configure
from tests.unit.estimator.bench import DEMO, TAUGHT, Bench, a_rig

LINEAR = configure(a_rig(None))
IDENTIFIED = configure(a_rig(TAUGHT))
BOTH = pytest.mark.parametrize("config", [LINEAR, IDENTIFIED], ids=["linear", "identified"])
NONE_UM = (1e300, -1e300, 10_000.0, nan, inf, -inf)
NONE_V = (1e300, -1e300, 9.01, -6.01, nan, inf)
"""The limits are -1 V and 4 V, 5 V apart."""


@BOTH
@pytest.mark.parametrize("x_um", NONE_UM)
def test_a_position_beyond_the_sensors_range_is_invalid(
    config: EstimatorConfig, x_um: float
) -> None:
    spoilt, sound = Bench(config), Bench(config)
    for bench in (spoilt, sound):
        bench.rest(0.0, 0.0)
    estimate = spoilt.feed(x_um, 0.0)
    assert (estimate.valid, estimate.degraded, estimate.arms[0].x_um) == (False, False, 0.0)
    assert "outside -9999..9999 µm" in fault_text(estimate.fault)
    sound.seq += 1
    # What follows is as after a sample without a measurement.
    assert spoilt.feed(0.5, 0.1).arms[0].force_mN == pytest.approx(
        sound.feed(0.5, 0.1).arms[0].force_mN, abs=0.01
    )


@BOTH
@pytest.mark.parametrize("voltage_V", NONE_V)
def test_an_impossible_voltage_does_not_change_the_model(
    config: EstimatorConfig, voltage_V: float
) -> None:
    bench = Bench(config)
    bench.rest(0.0, 0.2)
    before = bench.state
    estimate = bench.feed(0.0, voltage_V)
    assert (estimate.valid, estimate.degraded) == (False, True)
    assert estimate.arms[0].applied_V == before.arms[0].response.voltage_V
    assert bench.state.refused == before.refused + 1
    assert bench.state.arms[0].response == before.arms[0].response
    assert bench.state.arms[0].past == before.arms[0].past
    assert bench.feed(0.0, 0.2).valid


@pytest.mark.parametrize(("x_um", "voltage_V"), [(9999.0, 0.0), (-9999.0, 9.0), (0.0, -6.0)])
def test_values_at_the_limits_are_accepted(x_um: float, voltage_V: float) -> None:
    assert Bench(LINEAR).feed(x_um, voltage_V).valid


def test_the_position_range_is_mirrored_if_the_sensor_faces_the_other_side() -> None:
    sensor = DEMO.sensor.model_copy(
        update={"minimum_um": -100.0, "maximum_um": 300.0, "offset_um": 50.0, "direction": -1}
    )
    assert configure(DEMO.model_copy(update={"sensor": sensor})).arms[0].position_um == (
        -250.0,
        150.0,
    )
