"""A drift of the sensor is part of U, and grows with the age of the zero."""

from math import sqrt

import pytest

from pincette.control.force.estimation import COVERAGE
from pincette_estimator.config import configure
from pincette_estimator.uncertainty import creep_um

from .bench import TAUGHT, Bench, a_rig

UM_PER_MIN = 0.6
AGE_S = 30.0


def stated_mN(drift_um_per_min: float) -> tuple[float, float]:
    """Return U just after the zero, and 30 s later, of an arm at rest."""
    rig = a_rig(TAUGHT)
    sensor = rig.sensor.model_copy(update={"drift_um_per_min": drift_um_per_min})
    bench = Bench(configure(rig.model_copy(update={"sensor": sensor})))
    for _ in range(40):
        bench.feed(0.0, 0.0)
    bench.feed(0.0, 0.0, zero=True)
    fresh = bench.feed(0.0, 0.0)
    assert fresh.arms[0].zero_age_s is not None
    later = fresh
    while (later.arms[0].zero_age_s or 0.0) < AGE_S:
        later = bench.feed(0.0, 0.0)
    return fresh.arms[0].force_uncertainty_mN, later.arms[0].force_uncertainty_mN


def test_U_grows_by_the_drift_since_the_zero() -> None:
    without, with_drift = stated_mN(0.0), stated_mN(UM_PER_MIN)
    assert with_drift[0] == pytest.approx(without[0], abs=1e-3)
    s_p = a_rig(TAUGHT).model.compliance_um_per_mN
    drift_mN = COVERAGE * UM_PER_MIN / 60.0 * AGE_S / sqrt(3.0) / s_p
    assert with_drift[1] == pytest.approx(sqrt(without[1] ** 2 + drift_mN**2), rel=0.01)


def test_a_drift_does_not_make_a_zero_implausible() -> None:
    rig = a_rig(TAUGHT)
    sensor = rig.sensor.model_copy(update={"drift_um_per_min": UM_PER_MIN})
    config = configure(rig.model_copy(update={"sensor": sensor}))
    more_um = creep_um(config.arms[0], AGE_S) - creep_um(configure(rig).arms[0], AGE_S)
    assert more_um == pytest.approx(UM_PER_MIN / 60.0 * AGE_S)


def test_the_drift_of_a_long_hold_does_not_refuse_the_next_zero() -> None:
    rig = a_rig(TAUGHT)
    sensor = rig.sensor.model_copy(update={"drift_um_per_min": 6.0})
    bench = Bench(configure(rig.model_copy(update={"sensor": sensor})))
    for _ in range(40):
        bench.feed(0.0, 0.0)
    bench.feed(0.0, 0.0, zero=True)
    played_s = 60.0
    for _ in range(round(played_s / rig.rig.period_s)):
        bench.feed(0.0, 0.0)
    assert bench.state.arms[0].zero_s is not None
    bench.arm(2)
    assert bench.state.arms[0].kept_age_s == pytest.approx(played_s, abs=0.1)
    bench.arm(3)
    assert bench.state.arms[0].kept_age_s == pytest.approx(played_s, abs=0.1)
    drifted_um = -0.9 * 6.0 / 60.0 * played_s
    for _ in range(40):
        bench.feed(drifted_um, 0.0)
    bench.feed(drifted_um, 0.0, zero=True)
    assert bench.state.arms[0].zero_refusal is None
    assert bench.state.arms[0].kept_age_s == 0.0
