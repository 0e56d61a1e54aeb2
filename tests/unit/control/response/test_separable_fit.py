"""Separable fit of weights and creep, and its use in the identification."""

import numpy as np
import pytest

from pincette.control.response.hysteresis import HysteresisModel
from pincette.control.response.hysteresis_motion import Column, low_passed, play_columns, simulate
from pincette.control.response.identification import identify_free_response
from pincette.control.response.separable_fit import MOST_CREEP, separable_fit

PERIOD_S = 0.02
THRESHOLDS_V, TIMES_S = (0.0, 0.4, 0.8), (0.5, 5.0)
MODEL = HysteresisModel(THRESHOLDS_V, (12.0, 4.0, 2.0), TIMES_S, (0.03, 0.05))


def drive(count: int) -> Column:
    """Return two incommensurate swings, which give nested loops."""
    k = np.arange(count)
    return 1.2 * np.sin(0.011 * k) + 0.9 * np.sin(0.037 * k)


def measured_um(voltage_V: Column, period_s: float = PERIOD_S) -> Column:
    """Return free motion of the model, with the noise of a sensor."""
    noise_um = np.random.default_rng(1).normal(0.0, 0.03, len(voltage_V))
    return simulate(MODEL, voltage_V, period_s) + noise_um + 5.0


def fitted(x_um: Column, voltage_V: Column) -> tuple[list[float], list[float]]:
    static = play_columns(THRESHOLDS_V, (), voltage_V)
    found = separable_fit(static, low_passed(TIMES_S, static, PERIOD_S), x_um, 1e-9)
    return found.weights.tolist(), found.fractions.tolist()


def test_weights_and_creep_are_identified_together() -> None:
    voltage_V = drive(3000)
    weights, fractions = fitted(simulate(MODEL, voltage_V, PERIOD_S) + 70.0, voltage_V)
    assert weights == pytest.approx(MODEL.weights_um_per_V, rel=1e-3)
    assert fractions == pytest.approx(MODEL.creep_fractions, rel=1e-2)


def test_creep_in_the_wrong_direction_is_set_to_zero() -> None:
    voltage_V = drive(3000)
    back = HysteresisModel(THRESHOLDS_V, (12.0, 4.0, 2.0), TIMES_S, (-0.05, -0.05))
    _, fractions = fitted(simulate(back, voltage_V, PERIOD_S), voltage_V)
    assert fractions == [0.0, 0.0]


def test_at_least_part_of_the_displacement_is_immediate_and_not_creep() -> None:
    """A completely low-passed displacement allows no static term."""
    voltage_V = drive(3000)
    x_um = low_passed((0.5,), 19.0 * voltage_V[:, np.newaxis], PERIOD_S)[0, :, 0]
    _, fractions = fitted(x_um, voltage_V)
    assert sum(fractions) <= MOST_CREEP / (1.0 - MOST_CREEP) * (1.0 + 1e-9)


@pytest.mark.parametrize("period_s", [0.005, 0.02])
def test_the_residual_is_that_of_the_model_returned(period_s: float) -> None:
    voltage_V = drive(4000)
    x_um = measured_um(voltage_V, period_s)
    found = identify_free_response(voltage_V.tolist(), x_um.tolist(), period_s)
    own_um = float(np.std((x_um - simulate(found.model, voltage_V, period_s))[3000:]))
    assert found.residual_um == pytest.approx(own_um, rel=1e-9)
    assert own_um < 0.008 * np.ptp(x_um)


MOVED = drive(2000)


@pytest.mark.parametrize(
    ("voltage_V", "text"),
    [
        (
            np.concatenate([MOVED, np.full(1000, MOVED[-1])]),
            r"rests in the 750 samples to be held out, must travel at least 0\.\d+ V",
        ),
        (
            np.concatenate([np.zeros(3000), MOVED[:1000]]),
            "rests in the 3000 samples to be fitted",
        ),
    ],
    ids=["idle last", "idle until the part held out"],
)
def test_a_record_of_rest_only_is_refused(voltage_V: Column, text: str) -> None:
    for unpoled in (True, False):
        with pytest.raises(ValueError, match=text):
            identify_free_response(
                voltage_V.tolist(), measured_um(voltage_V).tolist(), PERIOD_S, unpoled=unpoled
            )
