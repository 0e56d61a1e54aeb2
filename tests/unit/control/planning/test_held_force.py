"""Plans of a new force on a part that one arm holds."""

from dataclasses import replace

import pytest

from pincette.config import derived
from pincette.control.planning.held_force import HeldForceRequest, HeldStart, plan_held_force
from pincette.control.planning.motion_plan import MotionPlan
from tests.support.rigs import demo_rig

RIG = derived.planned_rig(demo_rig(time="lockstep"))
REQUEST = HeldForceRequest(
    force_mN=15.0,
    load_s=1.0,
    hold_s=1.0,
    release_s=2.0,
    contact_force_mN=2.0,
    stiffness_mN_per_um=2.17,
    stiffness_tolerance=0.3,
)
HELD = HeldStart(35.0, 2.2, 10.0, 0.5)
POINTERS = {"load": "/force_mN", "hold": "/force_mN", "unload slew": "/release_s"}


def planned(held: HeldStart = HELD, **changes: float) -> MotionPlan:
    return plan_held_force(replace(REQUEST, **changes), RIG, held, 0.0, POINTERS)


@pytest.mark.parametrize("force_mN", [5.0, 10.0, 15.0])
def test_a_force_change_starts_at_the_present_force_and_ends_at_the_new_one(
    force_mN: float,
) -> None:
    plan = planned(force_mN=force_mN)
    assert plan.violations == ()
    assert [phase.phase for phase in plan.phases] == ["load", "hold", "unload"]
    course = plan.course
    assert (course.force_r_mN[0], course.voltage_V[0]) == pytest.approx((10.0, 2.2))
    load, hold, unload = plan.phases
    assert load.force_mN == hold.force_mN == pytest.approx(force_mN)
    assert load.x_um == pytest.approx(35.0 + (force_mN - 10.0) / 2.17)
    assert (load.voltage_V - 2.2) * (force_mN - 10.0) >= 0.0
    assert unload.voltage_V == 0.0


def test_the_program_of_a_force_change_takes_over_the_force_and_has_a_planned_range() -> None:
    program = planned().program
    assert program.takes_force_over
    assert program.planned_range is not None
    assert program.planned_range.voltages[0].max_V > max(planned().course.voltage_V)
    assert program.planned_range.force_max_mN == 15.0


@pytest.mark.parametrize(
    ("force_mN", "pointer", "words"),
    [
        (4.0, "/force_mN", "twice the contact force"),
        (41.0, "/force_mN", "above the limit 40 mN"),
        (5.0, "/force_mN", "expanded uncertainty"),
    ],
)
def test_a_force_that_cannot_be_held_is_named(force_mN: float, pointer: str, words: str) -> None:
    unsure = replace(HELD, uncertainty_mN=6.0) if force_mN == 5.0 else HELD
    found = planned(unsure, force_mN=force_mN).violations
    assert [one.pointer for one in found if words in one.message] == [pointer]


def test_a_force_change_that_is_too_short_is_named() -> None:
    found = planned(load_s=0.1).violations
    assert "/load_s" in {one.pointer for one in found}


def test_an_impossible_number_is_refused() -> None:
    with pytest.raises(ValueError, match="force_mN"):
        replace(REQUEST, force_mN=0.0)
    with pytest.raises(ValueError, match="hold_s"):
        replace(REQUEST, hold_s=-1.0)
