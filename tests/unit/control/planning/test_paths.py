"""Paths: rest at both ends, derivatives, full amplitude, bounds, and encoding for the bus."""

from itertools import pairwise
from math import pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from pincette.control.planning.path_shapes import (
    peaks,
    ring_um,
    sinusoid,
    steps,
    triangle,
    waypoints,
)
from pincette.control.planning.paths import Knot, Path
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Track
from pincette.core.codec import decode, encode
from pincette.core.messages import Load

SINE = sinusoid("force", 12.0, 20.0, 0.5, 3)
TRIANGLE = triangle("force", 12.0, 20.0, 0.5, 3, 400.0)
STEPS = steps("force", [5.0, 15.0, 15.0, 8.0], 1.0, 40.0, 900.0)
POINTS = waypoints("force", [(0.0, 5.0), (0.5, 9.0), (2.0, 12.0), (3.0, 4.0)])
PATHS = pytest.mark.parametrize(
    "path", [SINE, TRIANGLE, STEPS, POINTS], ids=lambda path: str(path.shape)
)


@PATHS
def test_a_path_is_at_rest_at_both_ends_and_outside_its_duration(path: Path) -> None:
    end_s = path.duration_s
    for t_s in (-1.0, 0.0, end_s, end_s + 1.0):
        point = path.point(t_s)
        assert point.rate == pytest.approx(0.0, abs=1e-12)
        assert point.acceleration == pytest.approx(0.0, abs=1e-9)
    assert path.at(0.0) == path.at(-1.0) == path.start
    assert path.at(end_s + 1.0) == pytest.approx(path.at(end_s))


@PATHS
def test_rate_and_acceleration_are_the_derivatives_of_the_value(path: Path) -> None:
    h = 1e-5
    for look in range(1, 400):
        t_s = path.duration_s * look / 400.0 + 1e-3
        before, here, after = path.point(t_s - h), path.point(t_s), path.point(t_s + h)
        assert here.rate == pytest.approx((after.value - before.value) / (2.0 * h), abs=1e-4)
        slope = (after.rate - before.rate) / (2.0 * h)
        # The corner of a triangle begins at once; everywhere else the acceleration is continuous.
        near = abs(after.acceleration - before.acceleration) > 1.0
        assert near or here.acceleration == pytest.approx(slope, abs=0.2)


@PATHS
def test_paths_have_no_jumps(path: Path) -> None:
    found, step_s = peaks(path), 1e-3
    points = [path.point(step_s * k) for k in range(int(path.duration_s / step_s) + 2)]
    for one, other in pairwise(points):
        assert abs(other.value - one.value) <= found.rate * step_s * 1.002
        assert abs(other.rate - one.rate) <= found.acceleration * step_s * 1.01
    assert max(point.value for point in points) <= found.highest + 1e-6
    assert min(point.value for point in points) >= found.lowest - 1e-6


def test_a_sinusoid_has_whole_cycles_at_full_amplitude() -> None:
    assert (SINE.full_from_s, SINE.full_to_s, SINE.duration_s) == (2.0, 8.0, 10.0)
    for cycle in range(3):
        start_s = SINE.full_from_s + cycle * 2.0
        assert SINE.at(start_s) == pytest.approx(12.0)
        assert SINE.at(start_s + 0.5) == pytest.approx(22.0)
        assert SINE.at(start_s + 1.5) == pytest.approx(2.0)
        assert SINE.at(start_s + 1.0 / 6.0) == pytest.approx(17.0)
    assert all(2.0 < SINE.at(0.01 * tick) < 22.0 for tick in range(200))


def test_the_peaks_of_a_sinusoid_are_found() -> None:
    found = peaks(SINE)
    assert (found.lowest, found.highest) == pytest.approx((2.0, 22.0), rel=1e-3)
    assert found.rate == pytest.approx(10.0 * pi, rel=1e-3)
    assert SINE.point(2.5).acceleration == pytest.approx(-10.0 * pi * pi)
    # While the amplitude grows it is a little more.
    assert 1.0 < found.acceleration / (10.0 * pi * pi) < 1.15
    assert found.acceleration_at_s < SINE.full_from_s


def test_a_triangle_is_straight_between_corners_that_keep_the_acceleration() -> None:
    middle_s = TRIANGLE.full_from_s + TRIANGLE.cycle_s
    rate = TRIANGLE.point(middle_s).rate
    for share in (-0.15, -0.05, 0.1, 0.15):
        point = TRIANGLE.point(middle_s + 2.0 * share)
        assert point.rate == pytest.approx(rate)
        assert point.acceleration == 0.0
    # A little faster than the 20 mN/s of a sharp one, since the corners are slow.
    assert 20.0 < rate < 22.0
    corner = TRIANGLE.point(middle_s + 0.5)
    assert corner.value == pytest.approx(22.0)
    assert corner.rate == pytest.approx(0.0, abs=1e-9)
    assert corner.acceleration == pytest.approx(-0.75 * 400.0)


@pytest.mark.parametrize("acceleration", [108.0, 150.0, 250.0, 400.0, 2000.0])
def test_a_triangle_keeps_its_acceleration_in_the_blend_too(acceleration: float) -> None:
    path = triangle("force", 12.0, 20.0, 0.5, 3, acceleration)
    assert 0.74 * acceleration < peaks(path).acceleration <= acceleration


def test_a_triangle_whose_corners_need_the_whole_cycle_consists_of_rounded_corners_only() -> None:
    path = triangle("force", 0.0, 2.0, 1.0, 1, 1.0)
    assert path.corner == 0.25
    assert path.at(path.full_from_s + 0.25) == pytest.approx(1.0)
    assert peaks(path).acceleration > 1.0


def test_steps_of_a_path_are_as_fast_as_permitted() -> None:
    found = peaks(STEPS)
    assert found.rate <= 40.0 * (1.0 + 1e-9)
    assert found.acceleration <= 900.0 * (1.0 + 1e-9)
    assert max(found.rate / 40.0, found.acceleration / 900.0) == pytest.approx(1.0, rel=1e-3)
    up_s = STEPS.knots[2].t_s - 1.0
    assert [STEPS.at(t_s) for t_s in (0.5, up_s + 1.5, up_s + 2.5)] == [5.0, 15.0, 15.0]
    assert STEPS.at(STEPS.duration_s - 0.5) == 8.0


def test_waypoints_are_passed_without_a_stop() -> None:
    for t_s, value in ((0.0, 5.0), (0.5, 9.0), (2.0, 12.0), (3.0, 4.0)):
        assert POINTS.at(t_s) == pytest.approx(value)
    assert POINTS.point(0.5).rate > 1.0
    assert POINTS.point(2.0).rate == 0.0


@settings(deadline=None, max_examples=30, derandomize=True)
@given(
    st.lists(st.tuples(st.floats(0.05, 3.0), st.floats(0.0, 30.0)), min_size=2, max_size=8),
    st.floats(0.0, 30.0),
)
def test_waypoints_never_overshoot(moves: list[tuple[float, float]], first: float) -> None:
    points = [(0.0, first)]
    for gap_s, value in moves:
        points.append((points[-1][0] + gap_s, value))
    path = waypoints("force", points)
    for (from_s, one), (to_s, other) in pairwise(points):
        low, high = min(one, other), max(one, other)
        for look in range(21):
            value = path.at(from_s + (to_s - from_s) * look / 20.0)
            assert low - 1e-6 <= value <= high + 1e-6


@PATHS
def test_an_encoded_program_contains_its_path(path: Path) -> None:
    segment = Track("track", path.duration_s, force=path)
    guards = Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.9, 1.0)
    load = Load(Program((segment,), guards, 2.17))
    assert decode(Load, encode(load)) == load


def test_impossible_paths_are_refused() -> None:
    with pytest.raises(ValueError, match=r"frequency = 0\.0 Hz, must be finite and above 0"):
        sinusoid("force", 12.0, 20.0, 0.0, 3)
    with pytest.raises(ValueError, match="0 cycles and 1 to blend, must be at least 1"):
        sinusoid("force", 12.0, 20.0, 1.0, 0)
    with pytest.raises(ValueError, match=r"time from point 0 to point 1 = -1\.0 s"):
        waypoints("force", [(1.0, 5.0), (0.0, 6.0)])
    with pytest.raises(ValueError, match="the first at 0 s"):
        waypoints("force", [(1.0, 5.0), (2.0, 6.0)])
    with pytest.raises(ValueError, match="0 levels, must be 1 to 2048"):
        steps("force", [], 1.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="begins and ends at rest"):
        replace(POINTS, knots=(Knot(0.0, 1.0, 0.5), Knot(1.0, 2.0, 0.0)))
    with pytest.raises(ValueError, match="corner = 0"):
        replace(TRIANGLE, corner=0.0)


def test_the_ring_of_an_acceleration_is_computed() -> None:
    assert ring_um(2437.8**2, 2437.8) == pytest.approx(1.0)
    assert ring_um(2000.0, 2437.8) == pytest.approx(3.4e-4, rel=0.02)
