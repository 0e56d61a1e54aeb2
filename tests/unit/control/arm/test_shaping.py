"""Steps of the voltage in three parts."""

from math import pi, sqrt

import numpy as np
import pytest

from pincette.control.arm.shaping import ShapedStep, shaped_ring, shaping_interval_s

OMEGA, KAPPA = 2437.8, 1.0
INTERVAL_S = shaping_interval_s(OMEGA, KAPPA)


def test_the_interval_is_half_a_period_between_the_free_and_the_pressed_mode() -> None:
    assert pytest.approx(1.066e-3, abs=2e-6) == INTERVAL_S
    assert shaping_interval_s(OMEGA, 0.0) == pytest.approx(pi / OMEGA)


@pytest.mark.parametrize("omega", [OMEGA, OMEGA * sqrt(1.0 + KAPPA)])
def test_the_computed_ring_equals_the_amplitude_of_a_numerically_integrated_mode(
    omega: float,
) -> None:
    zeta, dt_s = 1e-6, 1e-6
    steps = ShapedStep(0.0, 1.0, 0.0).parts_V()
    x, v, seen = 0.0, 0.0, list[float]()
    for tick in range(8000):
        aim = steps[min(int(tick * dt_s / INTERVAL_S), 2)]
        v += dt_s * (omega**2 * (aim - x) - 2.0 * zeta * omega * v)
        x += dt_s * v
        if tick * dt_s > 2.0 * INTERVAL_S:
            seen.append(x - 1.0)
    assert max(map(abs, seen)) == pytest.approx(shaped_ring(omega, INTERVAL_S), rel=0.05)
    assert shaped_ring(omega, INTERVAL_S) < 0.08


@pytest.mark.parametrize(("from_V", "to_V"), [(0.0, 1.0), (1.0, -0.5), (0.3, 0.3), (0.0, 1e-4)])
@pytest.mark.parametrize("step_V", [0.0, 20.0 / 2**16, 0.01])
def test_the_parts_of_a_shaped_step_stay_between_its_first_and_last_voltage(
    from_V: float, to_V: float, step_V: float
) -> None:
    parts_V = ShapedStep(from_V, to_V, 0.0).parts_V(step_V)
    assert parts_V[-1] == to_V
    assert min(from_V, to_V) <= min(parts_V)
    assert max(parts_V) <= max(from_V, to_V)
    moves = np.diff([from_V, *parts_V])
    assert np.all(moves * np.sign(to_V - from_V) >= 0.0)
    assert np.max(np.abs(moves)) <= 0.5 * abs(to_V - from_V) + step_V + 1e-12


@pytest.mark.parametrize(
    ("after", "share"), [(-0.1, 0.25), (0.0, 0.25), (0.99, 0.25), (1.01, 0.75), (2.01, 1.0), (9, 1)]
)
def test_the_output_voltage_at_a_time_is_known(after: float, share: float) -> None:
    step = ShapedStep(1.0, 2.0, 5.0)
    assert step.reached_V(5.0 + after * INTERVAL_S, INTERVAL_S) == pytest.approx(1.0 + share)
