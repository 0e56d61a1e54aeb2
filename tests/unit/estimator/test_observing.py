"""Use of the force observer by the estimator: which samples, and when it restarts."""

from math import pi, sin, sqrt

import pytest

from pincette.control.arm.mode import sample_mode
from pincette_estimator.config import EstimatorConfig, configure
from tests.unit.estimator.bench import TAUGHT, Bench, a_rig

D_P, S_P = 19.0, 0.46
SHORT = {
    name: configure(a_rig(None, period_s=0.001, force_observer=name))
    for name in ("inverse_dynamics", "kalman")
}
BOTH = pytest.mark.parametrize("config", SHORT.values(), ids=SHORT)


@pytest.mark.parametrize(("ages", "rms_mN"), [("matched", 0.0), ("printed", 3.67)])
def test_the_force_of_a_free_arm_follows_from_the_ages_of_its_samples(
    ages: str, rms_mN: float
) -> None:
    bench = Bench(configure(a_rig(None, force_ages=ages)))
    squares = 0.0
    for tick in range(-5, 100):
        voltage_V = sin(2.0 * pi * 0.5 * tick * 0.02)
        reading_mN = bench.feed(D_P * voltage_V, voltage_V).arms[0].force_mN
        squares += reading_mN * reading_mN if tick >= 0 else 0.0
    assert sqrt(squares / 100) == pytest.approx(rms_mN, abs=0.01)


@BOTH
def test_ringing_of_a_free_arm_is_not_reported_as_force(config: EstimatorConfig) -> None:
    mode = sample_mode(2437.8, 0.0260, 0.001)
    bench = Bench(config)
    bench.rest(0.0, 0.0)
    x_um = speed = 0.0
    furthest_um = 0.0
    for _ in range(50):
        offset_um = x_um - D_P * 0.1
        x_um = D_P * 0.1 + mode.xx * offset_um + mode.xv * speed
        speed = mode.vx * offset_um + mode.vv * speed
        furthest_um = max(furthest_um, x_um)
        assert bench.feed(x_um, 0.1).arms[0].force_mN == pytest.approx(0.0, abs=1e-9)
    assert furthest_um > 1.5 * D_P * 0.1


@BOTH
def test_after_a_gap_the_observer_restarts(config: EstimatorConfig) -> None:
    bench = Bench(config)
    bench.rest(0.0, 0.0)
    assert not bench.feed(1.0, None).valid
    assert bench.feed(-4.6, 0.0).arms[0].force_mN == pytest.approx(10.0)
    # Without a gap the same jump is not a static force.
    bench.rest(0.0, 0.0, count=100)
    assert bench.feed(-4.6, 0.0).arms[0].force_mN != pytest.approx(10.0, abs=0.1)


@BOTH
def test_a_zero_restarts_the_observer(config: EstimatorConfig) -> None:
    bench = Bench(config)
    bench.rest(0.0, 0.0)
    bench.rest(0.8, 0.0, count=80)
    assert bench.feed(0.8, 0.0, zero=True).arms[0].force_mN == pytest.approx(0.0, abs=1e-9)
    assert bench.feed(0.8, 0.0).arms[0].force_mN == pytest.approx(0.0, abs=1e-9)


def test_an_arming_restarts_the_observer() -> None:
    bench = Bench(configure(a_rig(TAUGHT, force_ages="printed")))
    bench.rest(0.0, 0.0)
    bench.feed(0.0, 1.0)
    bench.arm(2, zero_confirmed=True)
    assert bench.feed(12.0, 1.0).arms[0].force_mN == pytest.approx(0.0)
