"""What a voltage goes back and forth, and what is forgotten by it."""

import pytest

from pincette.control.force.reversal_memory import ReversalMemory, forgotten_mN


def total_V(*voltages_V: float) -> float:
    way = ReversalMemory(0.0)
    for voltage_V in voltages_V:
        way = way.follow(voltage_V)
    return way.total_V


def test_one_way_is_no_to_and_fro() -> None:
    assert total_V(0.5, 1.0, 1.0, 2.0) == 0.0


def test_one_large_reversal_counts_by_its_smaller_step() -> None:
    assert total_V(1.0, 2.0, 1.99, 1.0, 0.0) == pytest.approx(0.01)


def test_dither_adds_up() -> None:
    assert total_V(*[0.001 * (index % 2) for index in range(1, 101)]) == pytest.approx(0.099)


def test_what_is_forgotten_grows_at_once_and_is_bounded() -> None:
    def lost(V: float) -> float:
        return forgotten_mN(V, full_mN=3.0, scale_V=0.4)

    assert lost(0.0) == 0.0
    assert lost(0.01) == pytest.approx(3.0 * 0.01 / 0.4, rel=0.02)
    assert lost(0.1) < lost(0.2) < lost(50.0) == pytest.approx(3.0)
