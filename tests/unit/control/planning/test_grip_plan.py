"""A grip's plan: segments, guards, predicted motion, and every broken limit with its phase."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from pincette.control.planning.contact_plan import ContactPlan
from pincette.control.planning.feasibility import PlanLimits
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette.control.planning.segments import Move, Press, Rest, Seek
from pincette.control.response.hysteresis import HysteresisModel

from .bench import CONTACT, LIMITS, RIG

REQUEST = GripRequest(force_mN=20.0, hold_s=4.0, **CONTACT)
NARROW = HysteresisModel((0.0, 0.4), (15.0, 6.0))
WIDE = HysteresisModel((0.0, 0.5, 1.5), (8.0, 8.0, 8.0))
"""Loops whose arms need about -0.3 and -0.9 V to return to their starting position."""


def planned(
    request: GripRequest = REQUEST,
    limits: PlanLimits = LIMITS,
    x_start_um: float = 0.0,
    taught_V: tuple[float, float] | None = None,
    period_s: float = 0.02,
) -> ContactPlan:
    rig = replace(RIG, limits=limits, period_s=period_s, x_start_um=x_start_um, taught_V=taught_V)
    return plan_grip(request, rig)


def test_segments_are_in_order() -> None:
    program = planned().program
    assert [(segment.phase, type(segment)) for segment in program.segments] == [
        ("zero", Rest),
        ("approach", Move),
        ("approach", Rest),
        ("contact", Seek),
        ("load", Press),
        ("hold", Press),
        ("unload", Press),
        ("retreat", Move),
    ]
    approach, seek = program.segments[1], program.segments[3]
    assert isinstance(approach, Move)
    assert approach.to_um == (26.0,)
    assert approach.duration_s == pytest.approx(26.0 * 15.0 / 8.0 / 20.0)
    # The softest part, contacted last, still reaches the contact force 1 µm before the end.
    assert isinstance(seek, Seek)
    assert seek.to_um == pytest.approx((34.0 + 2.0 / 1.4,))
    assert seek.duration_s == pytest.approx((8.0 + 2.0 / 1.4) / 4.0)
    assert program.contact_stiffness_mN_per_um == 2.0


def back(free_response: HysteresisModel, **rig: Any) -> tuple[float, float]:
    """Return the final position of a grip, and the voltage there."""
    plan = plan_grip(REQUEST, replace(RIG, free_response=free_response, **rig))
    retreat = plan.program.segments[-1]
    assert isinstance(retreat, Move)
    assert retreat.to_um[0] is not None
    assert plan.violations == ()
    return retreat.to_um[0], plan.phases[-1].voltage_V


def test_the_arm_returns_to_its_start_if_it_can_reach_it() -> None:
    to_um, voltage_V = back(NARROW)
    assert to_um == 0.0
    assert 0.5 * LIMITS.voltage_min_V < voltage_V < 0.0


def test_an_arm_with_large_remanence_returns_to_its_rest_at_0_V() -> None:
    to_um, voltage_V = back(WIDE)
    assert 5.0 < to_um < 26.0
    # The softest part that is admitted would leave the arm at 0 V.
    assert 0.0 <= voltage_V < 0.2


def test_an_arm_that_cannot_go_below_0_V_does_not_return_below_its_remanence() -> None:
    unipolar = replace(LIMITS, voltage_min_V=0.0)
    plan = plan_grip(REQUEST, replace(RIG, limits=unipolar, free_response=NARROW))
    assert plan.violations == ()
    assert plan.phases[-1].voltage_V == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("rest_um", [-8.0, 0.0, 12.0, 60.0])
def test_the_return_ends_at_the_drifted_reading_but_not_closer_to_the_part_than_planned(
    rest_um: float,
) -> None:
    rested_um, _ = back(WIDE)
    to_um, _ = back(WIDE, rest_um=rest_um)
    # The arm never comes nearer to the part than the stand-off.
    assert to_um == pytest.approx(min(26.0, max(rested_um, rest_um)))


def test_strokes_of_an_arm_at_0_V_break_no_position_limit_whatever_its_reading() -> None:
    rig = replace(
        RIG,
        present_um=60.0,
        rest_um=60.0,
        free_response=NARROW,
        taught_V=(-1.0, 2.9),
        condition_V=-1.0,
    )
    plan = plan_grip(REQUEST, rig)
    assert plan.phases[0].phase == "condition"
    assert plan.violations == ()
    assert plan.course.voltage_V[0] == 0.0


def test_an_arm_that_starts_too_close_to_the_part_first_opens_to_its_final_position() -> None:
    rig = replace(RIG, present_um=35.0, free_response=WIDE)
    first, *_, last = plan_grip(REQUEST, rig).program.segments
    assert isinstance(first, Move)
    assert isinstance(last, Move)
    assert first.phase == "open"
    assert first.to_um == last.to_um


def test_a_plan_contains_the_guards_computed_from_part_and_limits() -> None:
    guards = planned().program.guards
    assert (guards.contact_force_mN, guards.contact_samples, guards.force_max_mN) == (2.0, 3, 40.0)
    assert guards.stiffness_min_mN_per_um == pytest.approx(1.4)
    assert guards.stiffness_max_mN_per_um == pytest.approx(2.6)


def test_position_force_and_voltage_of_a_planned_course_agree() -> None:
    plan = planned()
    assert plan.violations == ()
    course = plan.course
    sizes = {len(course.t_s), len(course.x_r_um), len(course.force_r_mN), len(course.voltage_V)}
    assert sizes == {int(plan.duration_s / 0.02) + 1}
    assert max(course.force_r_mN) == pytest.approx(20.0)
    for x_um, force_mN in zip(course.x_r_um, course.force_r_mN, strict=True):
        assert force_mN == pytest.approx(max(0.0, 2.0 * (x_um - 30.0)), abs=1e-9)
    # In the hold: x_r = 40 µm, u = (40 + 0.46·20)/19 V.
    hold = course.phase.index("hold")
    assert course.x_r_um[hold] == pytest.approx(40.0)
    assert course.voltage_V[hold] == pytest.approx(49.2 / 19.0)
    assert course.x_r_um[-1] == pytest.approx(0.0, abs=0.01)


def test_a_course_has_no_jump() -> None:
    course = planned(period_s=0.001).course
    for values, most in (
        (course.x_r_um, 0.0201),
        (course.force_r_mN, 0.02),
        (course.voltage_V, 0.002),
    ):
        jumps = [abs(b - a) for a, b in pairwise(values)]
        assert max(jumps) < most


def test_phases_follow_one_another_without_gaps_and_end_at_their_targets() -> None:
    plan = planned()
    t_s = 0.0
    for phase in plan.phases:
        assert phase.start_s == pytest.approx(t_s)
        t_s += phase.duration_s
    assert plan.duration_s == pytest.approx(t_s)
    touch = plan.phases[3]
    assert (touch.x_um, touch.force_mN) == pytest.approx((31.0, 2.0))
    assert touch.duration_s == pytest.approx(5.0 / 4.0)
    last = plan.phases[-1]
    assert (last.x_um, last.force_mN) == (0.0, 0.0)
    assert last.voltage_V == pytest.approx(0.0, abs=1e-3)


def test_a_hold_may_have_no_end() -> None:
    plan = planned(replace(REQUEST, hold_s=None))
    assert plan.program.segments[5].duration_s is None
    assert plan.phases[5].duration_s == 0.3


def test_a_short_approach_has_the_minimum_duration() -> None:
    plan = planned(x_start_um=25.9)
    assert plan.program.segments[1].duration_s == 0.3


def test_every_broken_limit_is_named_with_field_phase_and_time() -> None:
    limits = PlanLimits(-0.5, 2.0, -20.0, 35.0, 15.0, 10.0, 1e5)
    violations = planned(limits=limits).violations
    found = {violation.quantity: violation for violation in violations}
    assert len(violations) == 3
    assert set(found) == {"force", "voltage", "position"}
    force = found["force"]
    assert (force.pointer, force.limit, force.unit) == ("/force_mN", 15.0, "mN")
    assert force.value == pytest.approx(20.0)
    course = planned().course
    first = next(i for i, value in enumerate(course.force_r_mN) if value > 15.0)
    assert force.at_s == pytest.approx(course.t_s[first])
    assert course.phase[first] == "load"
    assert found["position"].value == pytest.approx(40.0)
    assert found["voltage"].value == pytest.approx(49.2 / 19.0)
    assert "force 20.000 mN above the limit 15 mN, from " in force.message


def test_each_violation_points_to_the_field_that_causes_it() -> None:
    def pointers(limits: PlanLimits) -> list[tuple[str, str]]:
        return [(v.quantity, v.pointer) for v in planned(limits=limits).violations]

    assert pointers(replace(LIMITS, voltage_max_V=1.0)) == [("voltage", "/contact_um")]
    assert pointers(replace(LIMITS, force_max_mN=1.0)) == [("force", "/contact_force_mN")]
    assert pointers(replace(LIMITS, position_min_um=0.5)) == [("position", ""), ("position", "")]
    assert pointers(replace(LIMITS, force_max_mN=20.0)) == []


def test_contact_before_the_start_is_refused() -> None:
    violations = planned(x_start_um=28.0).violations
    assert [(v.pointer, v.value, v.limit) for v in violations] == [("/contact_um", 26.0, 28.0)]
    assert "is before the start at 28 µm" in violations[0].message


def test_impossible_requests_are_refused() -> None:
    with pytest.raises(ValueError, match=r"force_mN = -3\.0, must be finite and above 0"):
        replace(REQUEST, force_mN=-3.0)
    with pytest.raises(ValueError, match=r"stiffness_tolerance = 1\.0 must be below 1"):
        replace(REQUEST, stiffness_tolerance=1.0)
    with pytest.raises(ValueError, match=r"period = 0\.0 s"):
        planned(period_s=0.0)


def test_a_plan_beyond_the_taught_voltages_is_refused_with_their_range() -> None:
    (violation,) = planned(taught_V=(-0.1, 2.5)).violations
    assert (violation.quantity, violation.limit, violation.unit) == ("taught_voltage", 2.5, "V")
    assert violation.value == pytest.approx((40.0 + 0.46 * 20.0) / 19.0, abs=0.01)
    assert violation.pointer == "/force_mN"
    assert "the free response was taught from -0.100 to 2.500 V" in violation.message
    assert "use less force, or calibrate free_response over a wider range" in violation.message


def test_a_plan_within_the_taught_voltages_is_accepted() -> None:
    assert planned(taught_V=(-0.1, 2.7)).violations == ()
    assert planned(taught_V=None).violations == ()
