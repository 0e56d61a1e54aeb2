"""The map of radii compared with single assessments."""

from dataclasses import replace

import pytest

from pincette.control.arm.plant import consistent_arm
from pincette.control.force.kalman import augmented_kalman
from pincette.control.force.observers import ForceObserver
from pincette.control.stability.assessment import assess, radius_map
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.worst_case import Intervals, around
from tests.support.laws import law_settings
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA

from .radii import spectral_radii

ARM = consistent_arm(OMEGA_N, ZETA, 19.0, S_P)
PART = around(2.17, 0.3)
DEFAULT = Loop(law_settings(), ARM, 0.02, force_filter_s=0.03)


def test_a_stability_map_consists_of_assessments() -> None:
    periods_s, gains = (0.01, 0.005), (1.0, 5.0)
    found = radius_map(DEFAULT, PART, periods_s=periods_s, gains=gains)
    assert found.shape == (2, 2)
    for row, period_s in enumerate(periods_s):
        for column, K_P in enumerate(gains):
            other = replace(DEFAULT, period_s=period_s).with_gains(K_P=K_P)
            assert found[row, column] == assess(other, PART).radius


def test_a_map_over_the_force_gain_uses_the_identified_model() -> None:
    gains, pressed = (0.0, 2500.0, 5000.0), replace(PART, free=False)
    found = radius_map(DEFAULT, pressed, periods_s=(0.005,), gains=gains, gain="K_f", worst=False)
    loop = replace(DEFAULT, period_s=0.005)
    expected = [spectral_radii(loop.with_gains(K_f=K_f), pressed.middle())[0] for K_f in gains]
    assert found[0] == pytest.approx(expected)
    assert found[0, 2] != pytest.approx(found[0, 0], abs=1e-3)


def test_a_map_builds_the_observer_for_each_period() -> None:
    def kalman(period_s: float) -> ForceObserver:
        return augmented_kalman(OMEGA_N, ZETA, S_P, period_s=period_s, noise_um=0.03)

    point = Intervals((2.17, 2.17), free=False)
    found = radius_map(
        DEFAULT, point, periods_s=(0.02, 0.002), gains=(1.0,), worst=False, observer_at=kalman
    )
    for row, period_s in enumerate((0.02, 0.002)):
        loop = replace(DEFAULT, period_s=period_s, observer=kalman(period_s))
        assert found[row, 0] == pytest.approx(spectral_radii(loop, point.middle())[0])
