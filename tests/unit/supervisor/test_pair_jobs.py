"""Jobs of two arms from their request to a plan."""

import dataclasses
from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from pincette.api.job_kinds import JobKind, job_kinds
from pincette.api.pairs import PairPlan
from pincette.api.requests import JobRequest
from pincette.config import ConfigError, RigFile, read_rig
from pincette.config.laws import installed_laws, law_definition, laws_by_name
from pincette.control.planning.segments import Drive, Stay, Track, paths_of
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job, require_arms
from pincette_supervisor.plugin import FaultyRequestError, Planned, Present
from tests.support.rigs import demo_rig
from tests.support.two_arms import TWO_ARMS

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
RIG = read_rig(TWO_ARMS)
HELD = Present(
    1.5, 30.0, True, second_V=1.6, second_um=29.0, force_mN=10.0, force_uncertainty_mN=0.5
)


def plan(body: dict[str, Any], present: Present | None = None, rig: RigFile = RIG) -> Planned:
    return plan_job(REQUEST.validate_python(body), rig, present)


def phases(planned: Planned) -> list[str]:
    return [segment.phase for segment in planned.program.segments]


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ({"kind": "grip"}, ["load", "hold", "unload", "retreat"]),
        ({"kind": "grip", "place_um": 4.0}, ["load", "carry", "hold", "unload", "retreat"]),
        ({"kind": "grip", "centre": True}, ["load", "hold", "unload", "retreat"]),
        ({"kind": "track", "place": {"pp_um": 4.0}}, ["settle", "track", "unload", "retreat"]),
        ({"kind": "carry", "by_um": 3.0}, ["move", "rest", "unload"]),
        ({"kind": "hold", "hold_s": 2.0}, ["hold", "unload"]),
        ({"kind": "hold", "force_mN": 15.0}, ["load", "hold", "unload"]),
        ({"kind": "release"}, ["unload"]),
    ],
)
def test_jobs_of_two_arms_are_planned(body: dict[str, Any], expected: list[str]) -> None:
    planned = plan(body, HELD if body["kind"] in ("carry", "hold", "release") else None)
    assert planned.plan.feasible, planned.plan.violations
    assert phases(planned)[-len(expected) :] == expected
    assert [spec.scheme for spec in planned.program.laws] == ["two_arms"]
    assert all(segment.arms in (2, None) for segment in planned.program.segments)


def test_a_carry_is_predicted_from_the_position_of_the_held_part() -> None:
    made = plan({"kind": "carry", "by_um": 3.0}, HELD).plan
    assert isinstance(made, PairPlan)
    places_um = made.curves.place_r_um
    assert (places_um[0], places_um[-1]) == pytest.approx((0.5, 3.5))


def test_the_prediction_of_a_new_force_starts_at_the_present_force_and_voltages() -> None:
    made = plan({"kind": "hold", "force_mN": 15.0, "hold_s": 1.0, "release_s": 2.0}, HELD).plan
    assert isinstance(made, PairPlan)
    curves = made.curves
    begin = curves.force_r_mN[0], curves.voltage_V[0], curves.second_voltage_V[0]
    assert begin == pytest.approx((10.0, 1.5, 1.6))
    assert curves.force_r_mN[-1] == pytest.approx(15.0)
    assert curves.place_r_um == pytest.approx([0.5] * len(curves.place_r_um))
    assert curves.x_r_um[-1] > curves.x_r_um[0]
    assert made.phases[1].voltage_V == pytest.approx(curves.voltage_V[-1], abs=0.01)
    assert made.phases[-1].start_s == pytest.approx(made.duration_s - 2.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"force_mN": 200.0}, "arm 2: force"),
        ({"force_mN": 0.5}, "twice the contact force"),
        ({"load_s": 0.01}, "identification"),
    ],
)
def test_a_new_force_that_cannot_be_held_is_named(changes: dict[str, Any], words: str) -> None:
    made = plan({"kind": "hold", "force_mN": 15.0, **changes}, HELD).plan
    (pointer,) = {each.pointer for each in made.violations if words in each.message}
    assert pointer == f"/{next(iter(changes))}"


def test_a_plan_has_the_course_of_both_arms_and_the_judgement_of_the_loop() -> None:
    made = plan({"kind": "grip"}).plan
    assert isinstance(made, PairPlan)
    curves = made.curves
    assert len({len(getattr(curves, name)) for name in type(curves).model_fields}) == 1
    assert max(curves.force_r_mN) == pytest.approx(RIG.grip.force_mN)
    assert made.law.scheme == "two_arms"
    assert made.law.spectral_radius < made.law.spectral_radius_limit


def test_a_limit_that_one_arm_breaks_is_reported_with_the_arm() -> None:
    made = plan({"kind": "track", "place": {"pp_um": 70.0}, "force_mN": 10.0}).plan
    assert not made.feasible
    for arm in (1, 2):
        assert any(f"arm {arm}: position" in each.message for each in made.violations)


def test_too_much_force_is_attributed_to_its_member() -> None:
    made = plan({"kind": "grip", "force_mN": 200.0}).plan
    assert {each.pointer for each in made.violations} >= {"/force_mN"}


def test_each_path_has_its_own_shape_and_duration() -> None:
    points = [{"t_s": 0.0, "place_um": 0.0}, {"t_s": 2.0, "place_um": 3.0}]
    body = {
        "kind": "track",
        "place": {"shape": "waypoints", "points": points},
        "force": {"shape": "step", "levels_mN": [8.0, 12.0], "dwell_s": 3.0},
    }
    track = next(one for one in plan(body).program.segments if isinstance(one, Track))
    assert track.force is not None
    assert track.place is not None
    assert track.place.duration_s == 2.0
    assert track.duration_s == track.force.duration_s > 2.0


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ({"kind": "track", "place": {"shape": "step", "pp_um": 3.0}}, "pp cannot be used with"),
        ({"kind": "track", "place": {"frequency_hz": 1.0}}, "needs pp"),
        ({"kind": "grip", "gains": {"K_P": 0.5}}, "no gain K_P; its gains are n, f_q, f_F"),
        ({"kind": "carry", "to_um": 3.0}, "the positions of the tips are not known"),
        ({"kind": "move", "to_um": 3.0}, "move is for 1 driven arm, and this rig has 2: it takes"),
        ({"kind": "track"}, "needs a path: give force, place or both"),
        ({"kind": "track", "cycles": 3}, "cycles is for 1 driven arm, and this rig has 2: omit"),
        ({"kind": "grip", "profile": "quick"}, "profile is for 1 driven arm, and this rig has 2"),
        ({"kind": "grip", "gains": "tuned"}, "is for 1 driven arm, but this rig has 2: give"),
    ],
)
def test_impossible_jobs_are_refused(body: dict[str, Any], said: str) -> None:
    with pytest.raises(FaultyRequestError, match=said):
        plan(body)


@pytest.mark.parametrize(
    "body",
    [
        {"kind": "track", "force": {}, "force_mN": 3.0},
        {"kind": "carry"},
        {"kind": "carry", "by_um": 1.0, "to_um": 1.0},
        {"kind": "grip", "centre": True, "hold_s": 1.0, "until_released": True},
    ],
)
def test_fields_that_exclude_each_other_are_refused(body: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        REQUEST.validate_python(body)


def test_kinds_and_laws_must_match_the_number_of_arms_of_a_rig() -> None:
    of_two = {name for name, kind in job_kinds().items() if 2 in kind.arms}
    assert of_two == {"grip", "track", "carry", "hold", "release", "calibrate"}
    with pytest.raises(FaultyRequestError, match="carry is for 2 driven arms"):
        plan({"kind": "carry", "by_um": 3.0}, rig=demo_rig())
    assert laws_by_name()["two_arms"].arms == 2
    assert "two_arms" not in installed_laws()
    with pytest.raises(ValueError, match="drives two arms"):
        law_definition("two_arms")
    with pytest.raises((ConfigError, ValidationError), match="drives two arms"):
        type(RIG.law)(scheme="two_arms")


MEMBERS = [
    pytest.param(kind, arms, names, id=f"{kind.name}-{arms}")
    for kind in job_kinds().values()
    for arms, names in kind.only.items()
]


@pytest.mark.parametrize(("kind", "arms", "names"), MEMBERS)
def test_a_field_for_another_number_of_arms_is_refused_by_name(
    kind: JobKind, arms: int, names: frozenset[str]
) -> None:
    rig, has = (demo_rig(), 1) if arms == 2 else (RIG, 2)
    assert names <= kind.request.model_fields.keys()
    for name in names:
        request = kind.request.model_construct({name, "kind"}, kind=kind.name, **{name: 3.0})
        with pytest.raises(FaultyRequestError, match=f"{name} is for {arms} .* rig has {has}: "):
            require_arms(request, rig)
        default = kind.request.model_fields[name].default
        require_arms(request.model_copy(update={name: default}), rig)
    shown = {field.name for field in kind.form if has in field.arms and not field.within}
    assert shown.isdisjoint(names)


def test_one_arm_of_two_is_calibrated_while_the_other_rests() -> None:
    body = {"kind": "calibrate", "calibration": "free_response"}
    first, second = (plan({**body, "arm": arm}).program for arm in (1, 2))
    for of_first, of_second in zip(first.segments, second.segments, strict=True):
        assert isinstance(of_first, Drive)
        assert isinstance(of_second, Drive)
        assert len(of_first.courses) == 1
        assert of_second.courses[0] == Stay()
        assert type(of_second.courses[1]) is type(of_first.courses[0])
    assert any(paths_of(segment) for segment in second.segments)


def test_a_calibration_that_touches_a_part_needs_a_single_arm() -> None:
    with pytest.raises(ValueError, match="a rig with one driven arm"):
        plan({"kind": "calibrate", "calibration": "contact_stiffness"})
    with pytest.raises(FaultyRequestError, match="this rig has one driven arm"):
        plan({"kind": "calibrate", "calibration": "noise", "arm": 2}, rig=demo_rig())


def taught(rig: RigFile, *least_V: float) -> RigFile:
    """Return the rig with arms that were identified from these voltages up to 3 V."""
    arms: list[dict[str, Any]] = []
    for arm, low_V in zip(rig.arms, least_V, strict=True):
        assert arm.model.free_response is not None
        known = arm.model.free_response.model_copy(update={"taught_V": (low_V, 3.0)})
        arms.append({"model": arm.model.model_copy(update={"free_response": known})})
    assert rig.second is not None
    second = rig.second.model_copy(update=arms[1])
    return rig.model_copy(update={**arms[0], "second": second})


def without_strokes(rig: RigFile) -> RigFile:
    """Return the rig whose grips make no conditioning strokes."""
    return rig.model_copy(update={"grip": rig.grip.model_copy(update={"condition": "never"})})


UNKNOWN_PAST = Present(0.0, 0.0, False, second_V=0.0, second_um=0.0, memory_known=False)


@pytest.mark.parametrize(
    "body",
    [
        {"kind": "grip"},
        {"kind": "grip", "centre": True},
        {"kind": "track", "place": {"pp_um": 4.0}},
    ],
)
def test_both_arms_make_strokes_before_they_touch_a_part(body: dict[str, Any]) -> None:
    rig = taught(RIG, -0.8, -0.5)
    plain, stroked = plan(body, rig=without_strokes(rig)), plan(body, UNKNOWN_PAST, rig)
    assert stroked.plan.violations == []
    assert phases(stroked) == [*["condition"] * 3, *phases(plain)]
    assert [one.phase for one in stroked.plan.phases] == phases(stroked)
    strokes_s = sum(one.duration_s or 0.0 for one in stroked.plan.phases[:3])
    assert stroked.plan.duration_s == pytest.approx(plain.plan.duration_s + strokes_s)
    assert isinstance(stroked.plan, PairPlan)
    curves = stroked.plan.curves
    assert min(curves.voltage_V) == pytest.approx(-0.8, abs=0.01)
    assert min(curves.second_voltage_V) == pytest.approx(-0.5, abs=0.01)
    planned = stroked.program.planned_range
    assert planned is not None
    first, second = planned.voltages
    assert first.min_V < -0.8
    assert second.min_V < -0.5


def test_an_arm_that_cannot_be_conditioned_rests_during_the_strokes_of_the_other() -> None:
    rig = taught(RIG, -0.8, 0.0)
    planned = plan({"kind": "grip"}, UNKNOWN_PAST, rig)
    for segment in planned.program.segments[:3]:
        assert isinstance(segment, Drive)
        assert isinstance(segment.courses[1], Stay)
    assert isinstance(planned.plan, PairPlan)
    known = dataclasses.replace(UNKNOWN_PAST, memory_known=True)
    followed = plan({"kind": "grip"}, known, rig).plan
    assert isinstance(followed, PairPlan)
    assert len(planned.plan.warnings) == len(followed.warnings) + 1


def test_a_held_part_is_carried_without_strokes() -> None:
    held = dataclasses.replace(HELD, memory_known=False)
    planned = plan({"kind": "carry", "by_um": 3.0}, held, taught(RIG, -0.8, -0.8))
    assert phases(planned) == ["move", "rest", "unload"]
