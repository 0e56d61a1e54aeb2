"""Properties that both laws share: boundary layer, band, and which integral is frozen."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.control.laws.sliding import saturation, sliding_band, winds_up


def test_saturation_is_a_line_within_the_layer_and_a_sign_beyond() -> None:
    at = (-5.0, -2.0, -1.0, 0.0, 0.5, 2.0, 9.0)
    assert [saturation(s, 2.0) for s in at] == [-1.0, -1.0, -0.5, 0.0, 0.25, 1.0, 1.0]


@settings(derandomize=True)
@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_saturation_is_odd_and_bounded_with_a_slope_of_at_most_one_over_the_boundary_layer(
    s: float, delta: float
) -> None:
    value = saturation(s, delta)
    assert value == -saturation(-s, delta)
    assert abs(value) <= min(1.0, abs(s) / delta)


@pytest.mark.parametrize(("K_S", "p"), [(0.5, 0.3), (0.5, -0.3), (0.0, 0.3), (0.5, 0.0)])
def test_outside_the_band_a_step_reduces_the_sliding_variable(K_S: float, p: float) -> None:
    """From the edge of the band the worst p̃ of this size lands on -s exactly; nearer, beyond."""
    a = 0.9
    edge = sliding_band(a, K_S, p)
    assert edge == pytest.approx(0.5 * a * (K_S + 0.3 * (p != 0.0)))
    after = [s - a * (K_S + abs(p)) for s in (edge, 0.9 * edge, 1.1 * edge)]
    assert after[0] == pytest.approx(-edge)
    assert abs(after[1]) > 0.9 * edge
    assert abs(after[2]) < 1.1 * edge


@pytest.mark.parametrize(
    ("limited", "error", "frozen"),
    [
        (1, -0.3, True),  # must not rise, position too low: the law requests more
        # must not rise, position too high: the law requests less and leaves the limit
        (1, 0.3, False),
        (-1, 0.3, True),
        (-1, -0.3, False),
        (0, -0.3, False),
        (0, 0.3, False),
        (1, 0.0, False),
        (-1, 0.0, False),
    ],
)
def test_an_active_limit_stops_the_integral_only_in_its_own_direction(
    limited: int, error: float, frozen: bool
) -> None:
    assert winds_up(limited, error) is frozen
