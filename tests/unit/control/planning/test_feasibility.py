"""Limits that a predicted motion breaks: each with its phase, its time, and the number of times."""

from dataclasses import replace
from math import cos, pi

import pytest

from pincette.control.planning.feasibility import (
    RING_UM,
    PlanLimits,
    acceleration_limit,
    excursions,
)
from pincette.control.planning.path_shapes import ring_um
from pincette.control.planning.prediction import Course

T = 0.02
WIDE = PlanLimits(-1e3, 1e3, -1e3, 1e3, 1e3, 1e6, 1e9)


def course(values: list[float]) -> Course:
    """Return a motion with equal position, force and voltage; the second half is named so."""
    count = len(values)
    phases = ["first" if k < count // 2 else "second" for k in range(count)]
    return Course([T * k for k in range(count)], phases, values, values, values)


SWING = course([-2.0 * cos(2.0 * pi * k / 50.0) for k in range(400)])


def test_a_course_within_all_limits_has_no_violations() -> None:
    assert excursions(SWING, WIDE) == ()


def test_oscillations_beyond_a_limit_count_as_one_excursion_per_phase() -> None:
    found = excursions(SWING, replace(WIDE, voltage_max_V=1.5))
    assert [(item.quantity, item.phase, item.times) for item in found] == [
        ("voltage", "first", 4),
        ("voltage", "second", 4),
    ]
    first = found[0]
    assert first.value == pytest.approx(2.0, abs=0.01)
    begins = next(k for k, value in enumerate(SWING.voltage_V) if value > 1.5)
    assert first.at_s == SWING.t_s[begins]
    low = excursions(SWING, replace(WIDE, position_min_um=-1.9))
    assert (low[0].quantity, low[0].value) == ("position", pytest.approx(-2.0, abs=0.01))


def test_the_rate_of_the_voltage_is_computed_from_tick_to_tick() -> None:
    # Peak rate 2·2π/(50·0.02 s) = 12.57 V/s, up and down.
    found = excursions(SWING, replace(WIDE, slew_V_per_s=10.0))
    assert {item.quantity for item in found} == {"slew"}
    assert {item.limit for item in found} == {10.0, -10.0}
    assert max(item.value for item in found) == pytest.approx(12.57, rel=1e-2)
    assert excursions(SWING, replace(WIDE, slew_V_per_s=12.6)) == ()


def test_the_acceleration_of_the_reference_is_its_second_difference() -> None:
    peak = 2.0 * (2.0 * pi / (50.0 * T)) ** 2
    found = excursions(SWING, replace(WIDE, acceleration_um_per_s2=0.9 * peak))
    assert {item.quantity for item in found} == {"acceleration"}
    assert max(item.value for item in found) == pytest.approx(peak, rel=1e-2)
    assert excursions(SWING, replace(WIDE, acceleration_um_per_s2=1.01 * peak)) == ()


def test_at_the_acceleration_limit_the_ring_equals_the_stated_value() -> None:
    assert ring_um(acceleration_limit(2437.8), 2437.8) == pytest.approx(RING_UM)
