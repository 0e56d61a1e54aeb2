"""Identification of a free response: from its own model class, and from a measured actuator."""

from math import sin
from pathlib import Path

import numpy as np
import pytest

from pincette.control.hysteresis import HysteresisModel
from pincette.control.identification import identify_free_response, simulate

PERIOD_S = 0.02
MODEL = HysteresisModel((0.0, 0.4, 0.8), (12.0, 4.0, 2.0), (0.5, 5.0), (0.03, 0.05))
MEASURED = Path(__file__).parents[4] / "shared/data/piezo-stack-hysteresis/Model_Vi_Do.dat"


def drive(count: int) -> list[float]:
    """Two incommensurate swings, so that loops lie within loops."""
    return [1.2 * sin(0.011 * k) + 0.9 * sin(0.037 * k) for k in range(count)]


def test_the_model_that_made_the_motion_is_found() -> None:
    voltage_V = drive(2000)
    noise_um = np.random.default_rng(1).normal(0.0, 0.03, 2000)
    x_um = simulate(MODEL, np.array(voltage_V), PERIOD_S) + noise_um + 70.0
    found = identify_free_response(
        voltage_V, x_um.tolist(), PERIOD_S, thresholds_V=(0.0, 0.4, 0.8), creep_times_s=(0.5, 5.0)
    )
    assert found.model.weights_um_per_V == pytest.approx(MODEL.weights_um_per_V, rel=0.02)
    assert found.model.creep_fractions == pytest.approx(MODEL.creep_fractions, rel=0.1)
    assert found.residual_um == pytest.approx(0.03, rel=0.1)


def test_collinear_plays_stay_bounded() -> None:
    voltage_V = drive(2000)
    x_um = simulate(MODEL, np.array(voltage_V), PERIOD_S)
    thresholds = [0.01 * index for index in range(80)]
    found = identify_free_response(voltage_V, x_um.tolist(), PERIOD_S, thresholds_V=thresholds)
    assert max(abs(weight) for weight in found.model.weights_um_per_V) < 20.0


@pytest.mark.parametrize(
    ("voltage_V", "x_um", "text"),
    [
        ([0.0] * 100, [0.0] * 99, "100 voltages for 99 positions"),
        (drive(50), [0.0] * 50, "50 samples, 60 are wanted for 3 coefficients"),
        ([0.001 * k for k in range(100)], [0.0] * 100, r"travels 0.099 V, must be above 0.500 V"),
        ([float("nan")] * 100, [0.0] * 100, "a sample is not finite"),
        (drive(100), [-19.0 * u for u in drive(100)], "slope up to .* V = -"),
    ],
)
def test_a_motion_that_teaches_nothing_is_refused(
    voltage_V: list[float], x_um: list[float], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        identify_free_response(voltage_V, x_um, PERIOD_S, thresholds_V=(0.0, 0.5))


def test_a_measured_piezo_stack_is_followed_within_one_percent() -> None:
    if not MEASURED.exists():
        pytest.skip("the measured hysteresis of a piezo stack is not beside this checkout")
    rows = np.loadtxt(MEASURED)[::4]
    voltage_V, x_um = rows[:, 0], rows[:, 4]
    found = identify_free_response(
        voltage_V.tolist(),
        x_um.tolist(),
        PERIOD_S,
        thresholds_V=[0.3 * index for index in range(6)],
        creep_times_s=(0.2, 2.0, 20.0),
        held_out=0.3,
    )
    assert found.residual_um < 0.01 * np.ptp(x_um)
