"""Speeds of a quick grip: contact is detected in time, and the load does not overshoot."""

from dataclasses import replace
from itertools import pairwise

import pytest

from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.contact_request import force_at_touch_mN
from pincette.control.planning.grip_plan import GripRequest, plan_grip
from pincette.control.planning.profiles import move, run_up
from pincette.control.planning.quick_grip import (
    EARLY_SHARE,
    FORCE_SHARE,
    LOAD_PERIODS,
    AskedSpeeds,
    QuickSpeeds,
    UsualSpeeds,
    load_duration,
    quick_speeds,
)
from pincette.control.planning.segments import Press, Seek
from pincette.control.planning.touch_force import SafeTouch

from .bench import CONTACT, RIG

NOTHING = AskedSpeeds(None, None, None, None)
USUAL = UsualSpeeds(120.0, 40.0, 40.0)
TOUCH = SafeTouch(
    20.0, 2.0, 2.17 * 1.3, RIG.compliance_um_per_mN, RIG.period_s, FORCE_SHARE, EARLY_SHARE
)


def speeds(
    asked: AskedSpeeds = NOTHING, touch: SafeTouch = TOUCH, rig: PlannedRig = RIG
) -> QuickSpeeds:
    found = quick_speeds(asked, USUAL, touch, 2.17, rig)
    assert found is not None
    return found


@pytest.mark.parametrize("force_mN", [4.5, 5.0, 8.0, 20.0, 35.0])
@pytest.mark.parametrize("period_s", [0.001, 0.02])
def test_a_touch_is_detected_below_the_permitted_share_of_the_planned_force(
    force_mN: float, period_s: float
) -> None:
    touch = TOUCH._replace(force_mN=force_mN, period_s=period_s)
    found = speeds(touch=touch, rig=replace(RIG, period_s=period_s))
    for v, share in ((found.approach_um_per_s, 0.75), (found.seek_um_per_s, 0.5)):
        at_mN = force_at_touch_mN(2.0, touch.hardest_mN_per_um, 0.46, v, period_s)
        assert at_mN <= share * force_mN + 1e-9
    assert not found.violations


def test_a_force_below_twice_the_contact_force_allows_no_quick_grip() -> None:
    assert quick_speeds(NOTHING, USUAL, TOUCH._replace(force_mN=4.0), 2.17, RIG) is None


@pytest.mark.parametrize(
    ("name", "share"), [("approach_um_per_s", EARLY_SHARE), ("seek_um_per_s", FORCE_SHARE)]
)
def test_a_speed_above_the_limit_is_refused_with_value_limit_and_remedy(
    name: str, share: float
) -> None:
    limit = TOUCH.limit(name)
    assert 100.0 < limit < 200.0
    found = speeds(NOTHING._replace(**{name: 210.0}))
    (violation, *_) = found.violations
    assert (violation.pointer, violation.value, violation.unit) == (f"/{name}", 210.0, "µm/s")
    assert violation.limit == pytest.approx(limit)
    assert f"{100.0 * share:g} % of 20 mN: move more slowly" in violation.message
    assert f"{limit:.3g} µm/s" in violation.message
    assert not speeds(NOTHING._replace(**{name: 0.99 * limit}, load_um_per_s=210.0)).violations


def test_a_shorter_period_allows_more_speed() -> None:
    fast, slow = TOUCH._replace(period_s=0.001), TOUCH
    assert fast.limit("seek_um_per_s") == pytest.approx(20.0 * slow.limit("seek_um_per_s"))


def test_a_long_load_lowers_the_speed_of_the_seek_before_it() -> None:
    found = speeds(NOTHING._replace(load_s=2.0))
    assert found.load_s == 2.0
    assert found.seek_um_per_s < 10.0
    assert not found.violations


def test_a_long_load_after_a_fast_seek_is_refused() -> None:
    found = speeds(NOTHING._replace(load_s=2.0, seek_um_per_s=40.0))
    (violation,) = found.violations
    assert (violation.pointer, violation.value) == ("/load_s", 2.0)
    assert violation.limit < 0.5
    assert "seek more slowly" in violation.message


def test_a_load_too_short_for_the_contact_line_is_refused() -> None:
    (violation,) = speeds(NOTHING._replace(load_s=0.1)).violations
    assert violation.pointer == "/load_s"
    assert violation.limit == pytest.approx(LOAD_PERIODS * 0.02)


def test_a_load_that_is_slower_than_the_seek_before_it_is_refused() -> None:
    (violation,) = speeds(NOTHING._replace(seek_um_per_s=40.0, load_um_per_s=10.0)).violations
    assert (violation.pointer, violation.value, violation.limit) == ("/load_um_per_s", 10.0, 40.0)


@pytest.mark.parametrize("peak", [10.0, 25.0, 40.0, 60.0, 120.0])
def test_a_load_keeps_its_speed_and_does_not_overshoot(peak: float) -> None:
    way_um, speed = 7.0, 25.0
    duration_s = load_duration(way_um, speed, peak)
    path = move(0.0, speed, way_um, 0.0, duration_s)
    times = [duration_s * place / 200 for place in range(201)]
    assert max(path.speed(t) for t in times) <= max(peak, speed) * (1.0 + 1e-3)
    assert min(path.speed(t) for t in times) >= -1e-9
    assert max(path.position(t) for t in times) <= way_um + 1e-9


def test_a_run_up_is_smooth_and_ends_at_its_target() -> None:
    assert run_up(6.0, 1.1, 0.2, 1.1) == pytest.approx((6.0, 6.0))
    assert run_up(6.0, 1.0, 0.0, 0.25) == (1.5, 6.0)
    step_s = 1e-4
    rows = [run_up(6.0, 1.1, 0.2, place * step_s) for place in range(4000)]
    for (before, speed), (after, _) in pairwise(rows):
        assert (after - before) / step_s == pytest.approx(speed, abs=0.05)
    assert max(abs(b[1] - a[1]) for a, b in pairwise(rows)) < 0.01


def test_the_speed_has_no_step_from_the_seek_to_the_end_of_the_load() -> None:
    found = speeds()
    part = CONTACT | {"stiffness_mN_per_um": 2.17, "zero_s": 0.3}
    request = GripRequest(force_mN=20.0, hold_s=4.0, quick=True, **part | found.values())
    plan = plan_grip(request, RIG)
    assert not plan.violations
    assert plan.duration_s - 4.0 < 3.0
    course, place = plan.course, slice(0, None)
    among = [index for index, phase in enumerate(course.phase) if phase in ("contact", "load")]
    place = slice(among[0], among[-1] + 5)
    x = course.x_r_um[place]
    rates = [(b - a) / 0.02 for a, b in pairwise(x)]
    # From rest to 40 µm/s in five periods, and down to rest again.
    assert max(rates) == pytest.approx(found.seek_um_per_s, rel=0.02)
    assert max(abs(b - a) for a, b in pairwise(rates)) < 0.35 * max(rates)
    # Contact with the softest part, which comes last, is confirmed before the seek is over.
    softest = 2.17 * 0.7
    seek = plan.program.segments[3]
    assert isinstance(seek, Seek)
    assert seek.to_um[0] is not None
    samples = (seek.to_um[0] - (33.0 + 2.0 / softest)) / (found.seek_um_per_s * 0.02)
    assert samples >= 3.0
    assert plan.program.segments[1].guarded
    load = plan.program.segments[4]
    assert isinstance(load, Press)
    assert load.follows
