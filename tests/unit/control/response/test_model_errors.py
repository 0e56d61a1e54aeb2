"""What an identified free response gets wrong: the straight line, and creep in a hold."""

import numpy as np
import pytest

from pincette.control.calibration.free_motion import secant_gain
from pincette.control.response.hysteresis_motion import Column
from pincette.control.response.model_errors import ZERO_AFTER_S, line_error, unknown_creep

PERIOD_S = 0.02


def hold(slope_um: float, seconds: float, seed: int) -> Column:
    """A hold that drifts by so much per decade of the age of its zero, under noise."""
    t_s = np.maximum(np.arange(round(seconds / PERIOD_S)) * PERIOD_S - ZERO_AFTER_S, 0.0)
    noise_um = np.random.default_rng(seed).normal(0.0, 0.03, len(t_s))
    return 7.0 + slope_um * np.log10(1.0 + t_s) + noise_um


def test_creep_is_that_of_all_holds_together() -> None:
    found = unknown_creep((hold(0.3, 6.0, 1), hold(-0.1, 12.0, 2)), PERIOD_S)
    assert found.value == pytest.approx(((0.3**2 + 0.1**2) / 2.0) ** 0.5, rel=0.1)
    # Two holds that differ by 0.2 µm say so.
    assert found.uncertainty == pytest.approx(0.1, rel=0.2)


def test_no_creep_is_little_more_than_its_uncertainty() -> None:
    found = unknown_creep((hold(0.0, 6.0, 3), hold(0.0, 12.0, 4)), PERIOD_S)
    assert found.value < 0.02
    with pytest.raises(ValueError, match="no holds, one is wanted at least"):
        unknown_creep((), PERIOD_S)


def test_an_ellipse_misses_its_chord_by_what_it_is_wide() -> None:
    """x lags by a phase: about the zero at the bottom the line errs by both branches."""
    phase = 2.0 * np.pi * np.arange(1000) / 100.0
    errors: list[float] = []
    for lag in (0.0, 0.05, 0.1):
        loop = secant_gain(np.sin(phase), 19.0 * np.sin(phase - lag), 100.0)
        errors.append(line_error((loop,)).value)
    assert errors[0] == pytest.approx(0.0, abs=1e-9)
    assert errors[2] == pytest.approx(2.0 * errors[1], rel=0.1)
    assert errors[2] == pytest.approx(0.1 / 3.0**0.5, rel=0.1)
