"""Reversals of a voltage, and those that larger ones erase."""

from math import sin

import pytest

from pincette.control.response.reversal_memory import SMALL_V, ReversalMemory, forgotten_share


def total_V(*voltages_V: float) -> float:
    way = ReversalMemory(0.0)
    for voltage_V in voltages_V:
        way = way.updated(voltage_V)
    return way.total_V


def test_travel_in_a_single_direction_is_not_counted_as_back_and_forth() -> None:
    assert total_V(0.5, 1.0, 1.0, 2.0) == pytest.approx(0.25 * SMALL_V)


def test_a_large_reversal_is_counted_only_up_to_the_width_of_a_small_one() -> None:
    assert total_V(1.0, 2.0, 1.99, 1.0, 0.0) == pytest.approx(0.75 * SMALL_V)


def test_small_back_and_forth_motions_accumulate() -> None:
    assert total_V(*[0.001 * (index % 2) for index in range(1, 101)]) == pytest.approx(0.05)


def test_the_drift_beneath_a_dither_does_not_count() -> None:
    drifting = [0.001 * (index % 2) - 1e-4 * index for index in range(1, 10001)]
    assert total_V(*drifting) == pytest.approx(4.5, rel=0.01)


@pytest.mark.parametrize("samples", [10, 1000])
def test_the_count_does_not_depend_on_the_sampling(samples: int) -> None:
    swings = [0.01 * sin(3.14159265 * (k + 0.5 * samples) / samples) for k in range(20 * samples)]
    assert total_V(*swings) == pytest.approx(20 * 0.01, rel=0.1)


def test_the_forgotten_share_grows_from_zero_and_is_bounded_by_one() -> None:
    assert forgotten_share(0.0, 0.4) == 0.0
    assert forgotten_share(0.01, 0.4) == pytest.approx(0.01 / 0.4, rel=0.02)
    assert forgotten_share(0.1, 0.4) < forgotten_share(0.2, 0.4) < forgotten_share(50.0, 0.4) == 1.0
