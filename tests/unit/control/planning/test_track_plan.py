"""A tracked path's plan: segments, predicted motion and voltage, and every broken limit."""

from dataclasses import replace
from itertools import pairwise

import pytest

from pincette.control.planning.contact_plan import ContactPlan, PlannedRig
from pincette.control.planning.path_shapes import sinusoid, steps
from pincette.control.planning.segments import Move, Press, Seek, Track
from pincette.control.planning.track_plan import TrackRequest, plan_track
from pincette.control.response.hysteresis import HysteresisModel

from .bench import CONTACT, RIG

PATH = sinusoid("force", 12.0, 20.0, 0.5, 2)
REQUEST = TrackRequest(
    path=PATH,
    rate_um_per_s=60.0,
    acceleration_um_per_s2=2000.0,
    pointer="/force_pp_mN",
    **CONTACT,
)


def planned(request: TrackRequest = REQUEST, rig: PlannedRig = RIG) -> ContactPlan:
    return plan_track(request, rig)


def found(plan: ContactPlan) -> list[tuple[str, str]]:
    return [(violation.quantity, violation.pointer) for violation in plan.violations]


def test_segments_are_in_order() -> None:
    segments = planned().program.segments
    assert [(segment.phase, type(segment)) for segment in segments[3:]] == [
        ("contact", Seek),
        ("load", Press),
        ("load", Press),
        ("settle", Press),
        ("track", Track),
        ("unload", Press),
        ("retreat", Move),
    ]
    forces_mN = [segment.to_mN for segment in segments[4:7] if isinstance(segment, Press)]
    assert forces_mN == pytest.approx([22, 12, 12])
    assert segments[7] == Track("track", 8.0, force=PATH)


def test_position_force_and_voltage_agree_at_every_point_of_the_path() -> None:
    plan = planned()
    assert plan.violations == ()
    course = plan.course
    tracked = [k for k, phase in enumerate(course.phase) if phase == "track"]
    assert max(course.force_r_mN[k] for k in tracked) == pytest.approx(22.0, abs=0.01)
    assert min(course.force_r_mN[k] for k in tracked) == pytest.approx(2.0, abs=0.01)
    for k in tracked:
        assert course.x_r_um[k] == pytest.approx(30.0 + course.force_r_mN[k] / 2.0)
        volts = (course.x_r_um[k] + 0.46 * course.force_r_mN[k]) / 19.0
        assert course.voltage_V[k] == pytest.approx(volts)
    jumps = [abs(b - a) for a, b in pairwise(course.x_r_um)]
    assert max(jumps) < 0.45


def test_the_voltage_follows_the_identified_free_response() -> None:
    model = HysteresisModel((0.0, 0.4), (15.0, 6.0), (1.0,), (0.05,))
    plan = planned(rig=replace(RIG, free_response=model))
    line = planned()
    course = plan.course
    assert course.x_r_um == line.course.x_r_um
    # Two branches: at one position on the way up and down, two voltages.
    start = course.phase.index("track")
    quarter = start + int((PATH.full_from_s + 0.25) / 0.02)
    falling = quarter + 25
    assert course.x_r_um[quarter] == pytest.approx(course.x_r_um[falling], abs=0.6)
    assert course.voltage_V[quarter] - course.voltage_V[falling] > 0.05
    assert plan.phases[-1].voltage_V != pytest.approx(0.0, abs=1e-3)


def test_every_limit_of_the_rig_is_named_in_its_phase() -> None:
    limits = replace(RIG.limits, force_max_mN=20.0, voltage_max_V=2.5)
    plan = planned(rig=replace(RIG, limits=limits))
    phases = {
        (v.quantity, v.message.partition("(")[2].split(",")[0].rstrip(")")) for v in plan.violations
    }
    assert {("force", "load"), ("force", "track"), ("voltage", "track")} <= phases
    assert {v.pointer for v in plan.violations} == {"/force_pp_mN"}
    track = next(v for v in plan.violations if "(track" in v.message and v.quantity == "force")
    assert "3 times" in track.message
    start_s = next(phase.start_s for phase in plan.phases if phase.phase == "track")
    assert start_s < track.at_s < start_s + PATH.duration_s


def test_a_part_is_not_pulled() -> None:
    plan = planned(replace(REQUEST, path=sinusoid("force", 9.0, 20.0, 0.5, 2)))
    assert found(plan) == [("force", "/force_pp_mN")]
    assert "a part is pressed, not pulled" in plan.violations[0].message
    assert plan.violations[0].value == pytest.approx(-1.0)


def test_the_refusal_of_a_path_beyond_its_rate_limits_points_to_the_frequency() -> None:
    fast = replace(REQUEST, path=sinusoid("force", 12.0, 20.0, 2.5, 2))
    assert found(planned(fast)) == [("rate", "/frequency_hz")]
    slow = replace(REQUEST, acceleration_um_per_s2=50.0)
    assert found(planned(slow)) == [("acceleration", "/frequency_hz")]


def test_a_cycle_has_at_least_ten_samples() -> None:
    plan = planned(replace(REQUEST, path=sinusoid("force", 12.0, 0.5, 6.0, 2)))
    assert found(plan) == [("frequency", "/frequency_hz")]
    assert plan.violations[0].limit == pytest.approx(5.0)


def test_a_voltage_that_rises_too_fast_is_named() -> None:
    levels = steps("force", [5.0, 30.0], 1.0, 600.0, 1e5)
    fast = replace(
        REQUEST, path=levels, rate_um_per_s=300.0, acceleration_um_per_s2=5e4, pointer="/levels_mN"
    )
    assert found(planned(fast)) == [("slew", "/levels_mN")]


def test_in_contact_only_force_paths_are_accepted() -> None:
    with pytest.raises(ValueError, match="must be one of force"):
        replace(REQUEST, path=sinusoid("position", 12.0, 20.0, 0.5, 2))
