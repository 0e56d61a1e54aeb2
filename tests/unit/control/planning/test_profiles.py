"""Quintic moves: ends, peaks, continuity."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pincette.control.planning.profiles import minimum_duration, move, quintic


def test_the_quintic_is_constant_outside_0_to_1_and_symmetric() -> None:
    assert [quintic(s) for s in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert quintic(0.3) + quintic(0.7) == pytest.approx(1.0)


def test_a_move_from_rest_to_rest_is_a_scaled_quintic() -> None:
    profile = move(3.0, 0.0, 11.0, 0.0, 2.0)
    for t_s in (0.1, 0.7, 1.0, 1.9):
        assert profile.position(t_s) == pytest.approx(3.0 + 8.0 * quintic(t_s / 2.0))
    assert (profile.position(-1.0), profile.position(2.0), profile.position(9.0)) == (3, 11, 11)


speeds = st.floats(-20.0, 20.0)


@settings(deadline=None, max_examples=25, derandomize=True)
@given(st.floats(-50.0, 50.0), speeds, st.floats(-50.0, 50.0), speeds, st.floats(0.1, 5.0))
def test_a_move_satisfies_its_boundary_conditions(
    x_0: float, v_0: float, x_1: float, v_1: float, duration_s: float
) -> None:
    profile = move(x_0, v_0, x_1, v_1, duration_s)
    h = 1e-4 * duration_s
    end = duration_s - h
    assert profile.position(h) == pytest.approx(x_0 + v_0 * h, abs=1e-6)
    assert profile.position(end) == pytest.approx(x_1 - v_1 * h, abs=1e-6)
    # The speed departs from its boundary value as h², that is, without acceleration.
    scale = (abs(x_1 - x_0) / duration_s + abs(v_0) + abs(v_1)) * 1e-6
    assert profile.speed(h) == pytest.approx(v_0, abs=scale + 1e-9)
    assert profile.speed(end) == pytest.approx(v_1, abs=scale + 1e-9)
    middle = 0.4 * duration_s
    slope = (profile.position(middle + h) - profile.position(middle - h)) / (2.0 * h)
    assert profile.speed(middle) == pytest.approx(slope, abs=100.0 * scale + 1e-6)


def test_at_the_minimum_duration_speed_or_acceleration_reaches_its_limit() -> None:
    by_speed = minimum_duration(-30.0, 20.0)
    profile = move(0.0, 0.0, -30.0, 0.0, by_speed)
    times = [by_speed * index / 1000 for index in range(1001)]
    assert max(abs(profile.speed(t)) for t in times) == pytest.approx(20.0)
    by_acceleration = minimum_duration(30.0, 1e6, 50.0)
    profile = move(0.0, 0.0, 30.0, 0.0, by_acceleration)
    h = by_acceleration / 1000
    speeds_found = [profile.speed(index * h) for index in range(1001)]
    peak = max(abs(b - a) / h for a, b in pairwise(speeds_found))
    assert peak == pytest.approx(50.0, rel=1e-3)
    assert minimum_duration(30.0, 20.0, 1e9) == by_speed


def test_impossible_moves_are_refused() -> None:
    with pytest.raises(ValueError, match=r"duration of a move = 0\.0 s"):
        move(0.0, 0.0, 1.0, 0.0, 0.0)
    with pytest.raises(ValueError, match=r"peak speed = -1\.0"):
        minimum_duration(1.0, -1.0)
