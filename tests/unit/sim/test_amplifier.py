import math
from itertools import pairwise

import pytest

from pincette.sim.plant.amplifier import IDEAL, AmplifierParameters, advance_amplifier


def _followed(
    amplifier: AmplifierParameters, input_V: float, dt_s: float, steps: int
) -> list[tuple[float, float]]:
    """Return slewed and output voltage after each step with a constant input, from 0 V."""
    slewed_V = output_V = 0.0
    result = list[tuple[float, float]]()
    for _ in range(steps):
        slewed_V, output_V = advance_amplifier(
            amplifier, slewed_V, output_V, (input_V, input_V), dt_s
        )
        result.append((slewed_V, output_V))
    return result


def test_an_ideal_amplifier_returns_its_input() -> None:
    assert _followed(IDEAL, 1.25, 1e-3, 1) == [(1.25, 1.25)]
    assert _followed(IDEAL, -90.0, 1e-6, 1) == [(-90.0, -90.0)]


def test_the_amplifier_has_its_gain_error_and_saturates() -> None:
    amplifier = AmplifierParameters(gain_ratio=1.01, saturation_V=3.0)
    assert _followed(amplifier, 2.0, 1e-3, 1)[0][1] == pytest.approx(2.02)
    assert _followed(amplifier, 2.98, 1e-3, 1)[0][1] == 3.0
    assert _followed(amplifier, -9.0, 1e-3, 1)[0][1] == -3.0


def test_the_slew_limit_is_kept_and_the_target_reached() -> None:
    path = _followed(AmplifierParameters(slew_V_per_s=500.0), 2.2, 1e-3, 6)
    assert [out_V for _, out_V in path] == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.2, 2.2])


def test_the_lag_is_exact_for_a_constant_input() -> None:
    lag_s = 1.0 / (2.0 * math.pi * 1000.0)
    amplifier = AmplifierParameters(lag_s=lag_s)
    out_V = _followed(amplifier, 1.0, 1e-4, 5)[-1][1]
    assert out_V == pytest.approx(1.0 - math.exp(-5e-4 / lag_s), rel=1e-12)


def test_slew_limit_and_lag_together_are_exact_for_any_time_step() -> None:
    amplifier = AmplifierParameters(slew_V_per_s=500.0, lag_s=4e-4)
    whole = _followed(amplifier, 1.3, 5e-3, 1)[-1]
    assert _followed(amplifier, 1.3, 5e-5, 100)[-1] == pytest.approx(whole, rel=1e-12)


def test_a_ramp_at_the_input_is_followed_with_a_lag() -> None:
    amplifier, slope = AmplifierParameters(lag_s=2e-4), 100.0
    slewed_V = output_V = 0.0
    for first, second in pairwise(slope * 1e-3 * index for index in range(11)):
        slewed_V, output_V = advance_amplifier(amplifier, slewed_V, output_V, (first, second), 1e-3)
    assert output_V == pytest.approx(1.0 - slope * 2e-4, rel=1e-9)
