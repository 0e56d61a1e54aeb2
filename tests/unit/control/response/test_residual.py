"""The residual table: lookup, identification from runs, and values relative to the last zero."""

import numpy as np
import pytest

from pincette.control.planning.recorded_motion import chained
from pincette.control.response.residual_identification import Place, identify_residual, smoothed
from pincette.control.response.residual_table import MOST_KNOTS, Residual, ResidualTable

NOISE_UM = 0.03


def test_a_residual_table_is_linear_between_knots_and_constant_after_the_last_knot() -> None:
    table = ResidualTable(4, ((0.0, 0.4), (), (0.1,)), 0.02)
    early = table.at(0, 1)
    assert early is not None
    assert early == (pytest.approx(0.1), 0)
    assert table.at(0, 4) == Residual(0.4, 0)
    assert table.at(0, 7) == Residual(0.4, 3)
    assert table.at(2, 5) == Residual(0.1, 5)
    assert table.at(1, 0) is None
    assert table.at(3, 0) is None
    assert table.at(-1, 0) is None


@pytest.mark.parametrize(
    ("stride", "knots", "error_um", "why"),
    [
        (0, ((0.0,),), 0.1, "stride = 0"),
        (1, ((0.0,),), -0.1, "error"),
        (1, ((0.0,) * (MOST_KNOTS + 1),), 0.1, "longer stride"),
    ],
)
def test_an_impossible_table_is_refused(
    stride: int, knots: tuple[tuple[float, ...], ...], error_um: float, why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        ResidualTable(stride, knots, error_um)


def test_smoothing_keeps_a_constant_series_unchanged_up_to_both_ends() -> None:
    assert smoothed(np.full(50, 0.7), 5.0) == pytest.approx(np.full(50, 0.7))


def test_the_residual_and_its_error_are_identified_from_two_noisy_runs() -> None:
    chance, count = np.random.default_rng(3), 800
    places = [Place(place // 200, 1 + place % 200) for place in range(count)]
    true_um = 0.1 * np.sin(np.arange(count) / 60.0)
    apart_um = 0.02
    runs = [true_um + side * apart_um + chance.normal(0.0, NOISE_UM, count) for side in (-0.5, 0.5)]
    found = identify_residual(places, runs, NOISE_UM)
    assert found.width_ticks >= 3.0
    error_um = found.residual_um - true_um
    assert float(np.sqrt(np.mean(error_um**2))) < 0.01
    # Of two runs that differ by 0.02 µm, enlarged by √3 since they are but two.
    assert found.error_um == pytest.approx(3.0**0.5 * apart_um, rel=0.3)
    read = np.array([(found.table.at(*place) or Residual(0.0, 0)).value_um for place in places])
    assert float(np.abs(read - found.residual_um).max()) < 0.02


def test_a_fast_residual_is_not_smoothed_away() -> None:
    chance, count = np.random.default_rng(4), 400
    places = [Place(0, 1 + place) for place in range(count)]
    true_um = 0.2 * np.sin(2.0 * np.pi * np.arange(count) / 10.0)
    runs = [true_um + chance.normal(0.0, NOISE_UM, count) for _ in range(2)]
    found = identify_residual(places, runs, NOISE_UM)
    assert float(np.sqrt(np.mean((found.residual_um - true_um) ** 2))) < 0.04


def test_a_residual_from_a_single_run_is_refused() -> None:
    with pytest.raises(ValueError, match="two runs at least"):
        identify_residual([Place(0, 1)], [np.zeros(1)], NOISE_UM)


def test_residuals_are_relative_to_the_last_zero() -> None:
    """The zero at position 6 moves the offset by 0.3; earlier values are moved by the same
    amount."""
    before, after = [0.1, 0.2, 0.3, 0.3, 0.3, 0.3], [0.0, 0.05, 0.1]
    zeroed = [False] * 6 + [True, False, False]
    found = chained(before + after, zeroed, rest=4)
    assert found == pytest.approx([-0.2, -0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.05, 0.1])
