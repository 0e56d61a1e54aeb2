"""Gain margins where they are known, and the map against single assessments."""

from dataclasses import replace

import numpy as np
import pytest

from pincette.control.arm.plant import consistent_arm
from pincette.control.arm.sampled_arm import LoopCase
from pincette.control.force.kalman import augmented_kalman
from pincette.control.force.observers import ForceObserver
from pincette.control.stability.assessment import assess, radius_map
from pincette.control.stability.loop_matrix import Loop
from pincette.control.stability.worst_case import Intervals, around
from tests.support.laws import law_settings
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA

from .margins import FARTHEST, gain_margin, spectral_radii

ARM = consistent_arm(OMEGA_N, ZETA, 19.0, S_P)
PART = around(2.17, 0.3)
DEFAULT = Loop(law_settings(), ARM, 0.02, force_filter_s=0.03)


@pytest.mark.parametrize("K_P", [0.5, 1.0, 5.0])
def test_the_margin_of_a_stiff_arm(K_P: float) -> None:
    """|1 - g·K_I/(K_P + K_I)| < 1 up to g = 2(K_P + K_I)/K_I, and downwards without end."""
    stiff = consistent_arm(1e6, 0.5, 19.0, S_P)
    loop = Loop(law_settings(K_P=K_P, M=0.0, B=0.0), stiff, 0.02)
    found = gain_margin(loop, (LoopCase(),))
    assert found.highest == pytest.approx(2.0 * (K_P + 1.0), rel=2e-3)
    assert found.lowest == pytest.approx(1.0 / FARTHEST)


def test_the_margin_is_where_the_radius_is_one() -> None:
    cases = PART.middle()
    found = gain_margin(DEFAULT, cases)
    for factor, stable in ((0.99, True), (1.01, False)):
        scaled = tuple(replace(case, gain_factor=factor * found.highest) for case in cases)
        assert bool(np.max(spectral_radii(DEFAULT, scaled)) < 1.0) is stable


def test_a_margin_can_end_below() -> None:
    """With a switching slope the voltage moves by more than a weak arm shows: it swings."""
    loop = replace(DEFAULT, law=law_settings(K_S=1.0, delta=1.0))
    case = (LoopCase(2.17, delay_periods=0.25),)
    found = gain_margin(loop, case)
    assert 1.0 / FARTHEST < found.lowest < 1.0
    just, beyond = (replace(case[0], gain_factor=found.lowest * by) for by in (1.01, 0.99))
    assert spectral_radii(loop, (just,))[0] < 1.0 <= spectral_radii(loop, (beyond,))[0]


def test_an_unstable_loop_has_no_margin() -> None:
    found = gain_margin(replace(DEFAULT, period_s=0.001), PART.middle())
    assert (found.lowest, found.highest) == (1.0, 1.0)


def test_a_map_is_made_of_assessments() -> None:
    periods_s, gains = (0.01, 0.005), (1.0, 5.0)
    found = radius_map(DEFAULT, PART, periods_s=periods_s, gains=gains)
    assert found.shape == (2, 2)
    for row, period_s in enumerate(periods_s):
        for column, K_P in enumerate(gains):
            other = replace(DEFAULT, period_s=period_s).with_gains(K_P=K_P)
            assert found[row, column] == assess(other, PART).radius


def test_a_map_over_the_force_gain_of_what_is_identified() -> None:
    gains, pressed = (0.0, 2500.0, 5000.0), replace(PART, free=False)
    found = radius_map(DEFAULT, pressed, periods_s=(0.005,), gains=gains, gain="K_f", worst=False)
    loop = replace(DEFAULT, period_s=0.005)
    expected = [spectral_radii(loop.with_gains(K_f=K_f), pressed.middle())[0] for K_f in gains]
    assert found[0] == pytest.approx(expected)
    assert found[0, 2] != pytest.approx(found[0, 0], abs=1e-3)


def test_a_map_makes_the_observer_for_each_period() -> None:
    def kalman(period_s: float) -> ForceObserver:
        return augmented_kalman(OMEGA_N, ZETA, S_P, period_s=period_s, noise_um=0.03)

    point = Intervals((2.17, 2.17), free=False)
    found = radius_map(
        DEFAULT, point, periods_s=(0.02, 0.002), gains=(1.0,), worst=False, observer_at=kalman
    )
    for row, period_s in enumerate((0.02, 0.002)):
        loop = replace(DEFAULT, period_s=period_s, observer=kalman(period_s))
        assert found[row, 0] == pytest.approx(spectral_radii(loop, point.middle())[0])
