"""Lateness relative to a grid that is known only from the samples."""

import pytest

from pincette.engine.timing_stats import SeenGrid

T = 0.02


def test_samples_on_their_grid_are_not_late() -> None:
    grid = SeenGrid(T)
    late = [grid.lateness_s(seq, 5.0 + seq * T) for seq in range(50)]
    assert late == pytest.approx([0.0] * 50, abs=1e-12)


def test_a_late_sample_leaves_the_grid_unchanged() -> None:
    grid = SeenGrid(T)
    delays_s = [0.0, 0.003, 0.0, 0.011, 0.001]
    late = [grid.lateness_s(seq, seq * T + delay_s) for seq, delay_s in enumerate(delays_s)]
    assert late == pytest.approx(delays_s)


def test_an_earlier_sample_moves_the_grid_earlier() -> None:
    grid = SeenGrid(T)
    delays_s = [0.004, 0.001, 0.001, 0.004]
    late = [grid.lateness_s(seq, seq * T + delay_s) for seq, delay_s in enumerate(delays_s)]
    assert late == pytest.approx([0.0, 0.0, 0.0, 0.003])


def test_lost_samples_leave_the_grid_unchanged() -> None:
    grid = SeenGrid(T)
    grid.lateness_s(0, 0.0)
    assert grid.lateness_s(7, 7 * T + 0.002) == pytest.approx(0.002)


def test_grid_points_that_the_sensor_missed_count_once_as_lateness() -> None:
    grid = SeenGrid(T)
    grid.lateness_s(0, 0.0)
    assert grid.lateness_s(1, 4 * T + 0.001) == pytest.approx(3 * T + 0.001)
    assert grid.lateness_s(2, 5 * T + 0.002) == pytest.approx(0.002)


def test_a_delay_of_more_than_a_period_ends_with_the_next_sample() -> None:
    grid = SeenGrid(T)
    grid.lateness_s(0, 0.0)
    assert grid.lateness_s(1, 2 * T + 0.005) == pytest.approx(T + 0.005)
    late = [grid.lateness_s(seq, seq * T) for seq in range(2, 6)]
    assert late == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=1e-12)


def test_numbers_that_restart_begin_a_new_grid() -> None:
    grid = SeenGrid(T)
    grid.lateness_s(900, 18.0)
    assert grid.lateness_s(0, 100.0) == 0.0
    assert grid.lateness_s(1, 100.0 + T + 0.001) == pytest.approx(0.001)
    grid.begin()
    assert grid.lateness_s(2, 300.0) == 0.0
