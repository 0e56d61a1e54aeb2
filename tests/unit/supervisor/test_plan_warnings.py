"""Warnings of plans about weak forces, goals that are not evaluated, and unsampled paths."""

from typing import Any

import pytest

from pincette.api.plans import MotionPlan, Plan
from pincette.cli import opened
from pincette.config import RigFile
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Planned, Present
from tests.support.checkout import ROOT

RIG = opened(ROOT / "deploy" / "rigs" / "demo.toml")
TWO_ARMS = opened(ROOT / "deploy" / "rigs" / "two-arms.toml")
CONTACT_MN = RIG.grip.contact_force_mN


def planned(rig: RigFile = RIG, **wish: Any) -> Planned:
    return plan_job(REQUEST.validate_python(wish), rig, Present(0.0, 0.0))


def warnings(rig: RigFile = RIG, **wish: Any) -> str:
    return "\n".join(getattr(planned(rig, **wish).plan, "warnings", ()))


LEVELS = {"shape": "step", "levels_mN": [1.0, 2.0 * CONTACT_MN]}
WEAK_LEVELS = {"shape": "step", "levels_mN": [0.5, 1.0]}
POINTS = [{"t_s": 0.0, "force_mN": 1.0}, {"t_s": 1.0, "force_mN": 2.0 * CONTACT_MN}]


@pytest.mark.parametrize(
    ("rig", "wish", "pointer"),
    [
        (RIG, {"kind": "grip", "force_mN": 0.001}, "/force_mN"),
        (RIG, {"kind": "grip", "force_mN": 1.0}, "/force_mN"),
        (RIG, {"kind": "grip", "force_mN": CONTACT_MN}, "/force_mN"),
        (RIG, {"kind": "grip", "force_mN": 2.0 * CONTACT_MN, "profile": "gentle"}, "/force_mN"),
        (RIG, {"kind": "grip", "force_mN": 10.0, "contact_force_mN": 5.0}, "/force_mN"),
        (RIG, {"kind": "track", **LEVELS}, "/levels_mN"),
        (RIG, {"kind": "track", "shape": "waypoints", "points": POINTS}, "/points"),
        (RIG, {"kind": "track", "force_mean_mN": 1.0, "force_pp_mN": 1.0}, "/force_pp_mN"),
        (TWO_ARMS, {"kind": "grip", "force_mN": 0.5}, "/force_mN"),
        (TWO_ARMS, {"kind": "grip", "centre": True, "force_mN": 0.5}, "/force_mN"),
        (TWO_ARMS, {"kind": "track", "force": WEAK_LEVELS}, "/force"),
    ],
)
def test_a_force_that_the_touch_would_exceed_is_refused_with_both_numbers(
    rig: RigFile, wish: dict[str, Any], pointer: str
) -> None:
    plan = planned(rig, **wish).plan
    assert not plan.feasible
    contact_mN = wish.get("contact_force_mN", rig.grip.contact_force_mN)
    (weak,) = [each for each in plan.violations if each.side == "below" and each.unit == "mN"]
    assert (weak.pointer, weak.quantity, weak.limit) == (pointer, "force", 2.0 * contact_mN)
    assert weak.value <= weak.limit
    assert weak.at_s > 0.0


def test_a_force_above_twice_the_contact_force_is_planned() -> None:
    assert planned(kind="grip", force_mN=2.1 * CONTACT_MN).plan.feasible
    assert planned(kind="grip", force_mN=2.0, contact_force_mN=0.9).plan.violations == []


@pytest.mark.parametrize(
    "wish",
    [
        {"kind": "grip", "hold_s": 0.3, "force_tolerance_mN": 0.1},
        {"kind": "grip", "hold_s": 0.5, "force_tolerance_mN": 0.3},
        {"kind": "grip", "hold_s": 2.0, "force_tolerance_mN": 0.3, "settling_s": 3.0},
    ],
)
def test_a_goal_that_will_not_be_judged_is_named_in_the_plan(wish: dict[str, Any]) -> None:
    plan = planned(**wish).plan
    assert plan.feasible
    assert isinstance(plan, Plan)
    assert plan.goal is not None
    assert plan.goal.judged is False
    assert plan.goal.lasts_s == wish["hold_s"]
    assert "settling_s" in warnings(**wish)


def test_a_move_rests_long_enough_to_judge_its_goal() -> None:
    for settling_s in (0.0, 0.6, 3.0):
        plan = planned(
            kind="move", to_um=5.0, position_tolerance_um=0.1, settling_s=settling_s
        ).plan
        assert isinstance(plan, MotionPlan)
        assert plan.goal is not None
        assert plan.goal.judged
        (rest,) = [phase for phase in plan.phases if phase.phase == "rest"]
        assert rest.duration_s is not None
        assert rest.duration_s > settling_s


@pytest.mark.parametrize(
    ("name", "value"),
    [("position_tolerance_um", 0.05), ("force_tolerance_mN", 1e-9)],
)
def test_a_tolerance_within_the_noise_is_named(name: str, value: float) -> None:
    assert name in warnings(RIG, **{"kind": "grip", name: value})


@pytest.mark.parametrize(
    ("wish", "name"),
    [
        ({"kind": "move", "by_V": 1e-4}, "by_V"),
        ({"kind": "move", "by_um": 1e-6}, "by_um"),
        ({"kind": "move", "to_um": 5.0, "warm_up_s": 0.1}, "warm_up_s"),
    ],
)
def test_a_plan_warns_of_requested_values_that_it_has_changed(
    wish: dict[str, Any], name: str
) -> None:
    stepped = RIG.model_copy(update={"output": RIG.output.model_copy(update={"step_V": 0.00122})})
    assert name in warnings(stepped, **wish)


GENTLE = {"kind": "grip", "profile": "gentle"}


@pytest.mark.parametrize(
    ("rig", "wish", "pointer", "quantity"),
    [
        (RIG, {**GENTLE, "seek_um_per_s": 1000.0}, "/seek_um_per_s", "speed"),
        (RIG, {**GENTLE, "approach_um_per_s": 400.0}, "/approach_um_per_s", "speed"),
        (RIG, {"kind": "track", "seek_um_per_s": 1000.0}, "/seek_um_per_s", "speed"),
        (TWO_ARMS, {"kind": "grip", "seek_um_per_s": 1000.0}, "/seek_um_per_s", "speed"),
        (
            TWO_ARMS,
            {"kind": "grip", "centre": True, "approach_um_per_s": 900.0},
            "/approach_um_per_s",
            "speed",
        ),
        (RIG, {**GENTLE, "load_s": 0.1}, "/load_s", "duration"),
        (RIG, {"kind": "track", "load_s": 0.1}, "/load_s", "duration"),
        (RIG, {"kind": "grip", "contact_force_mN": 0.05}, "/contact_force_mN", "force"),
        (RIG, {"kind": "track", "contact_force_mN": 1e-9}, "/contact_force_mN", "force"),
        (
            TWO_ARMS,
            {"kind": "grip", "centre": True, "contact_force_mN": 0.05},
            "/contact_force_mN",
            "force",
        ),
    ],
)
def test_an_impossible_touch_or_load_is_refused_by_its_member(
    rig: RigFile, wish: dict[str, Any], pointer: str, quantity: str
) -> None:
    plan = planned(rig, **wish).plan
    found = next(each for each in plan.violations if each.pointer == pointer)
    assert not plan.feasible
    assert found.quantity == quantity
    assert found.side == ("above" if quantity == "speed" else "below")


@pytest.mark.parametrize("force_mN", [2.0, 2.5, 5.0])
def test_usual_speeds_are_lowered_for_a_light_force(force_mN: float) -> None:
    values = planned(RIG, **{**GENTLE, "force_mN": force_mN, "contact_force_mN": 0.9})
    assert values.plan.violations == []
    assert values.values["seek_um_per_s"] <= RIG.grip.seek_um_per_s
    assert values.values["approach_um_per_s"] <= RIG.grip.approach_um_per_s


def test_a_force_within_its_own_uncertainty_is_refused() -> None:
    noisy = RIG.model_copy(update={"sensor": RIG.sensor.model_copy(update={"noise_um": 1.0})})
    plan = planned(noisy, kind="grip", force_mN=4.2).plan
    assert {"/contact_force_mN", "/force_mN"} <= {found.pointer for found in plan.violations}


@pytest.mark.parametrize(
    "wish",
    [
        {"kind": "grip", "hold_s": 2.0, "force_tolerance_mN": 0.1},
        {"kind": "grip", "hold_s": 0.3},
        {"kind": "grip", "until_released": True, "force_tolerance_mN": 0.1},
        {"kind": "move", "to_um": 5.0, "position_tolerance_um": 0.1},
        {"kind": "move", "to_um": 5.0, "position_tolerance_um": 0.1, "settling_s": 0.6},
    ],
)
def test_a_goal_that_can_be_judged_causes_no_warning(wish: dict[str, Any]) -> None:
    assert "settling_s" not in warnings(**wish)


def points(gap_s: float) -> list[dict[str, float]]:
    return [{"t_s": gap_s * at, "force_mN": 10.0 + 0.01 * at} for at in range(4)]


FORCES = {"shape": "waypoints", "points": points(0.005)}
PLACES = {
    "shape": "waypoints",
    "points": [{"t_s": 0.005 * at, "place_um": 0.001 * at} for at in range(4)],
}


@pytest.mark.parametrize(
    ("rig", "wish", "numbers"),
    [
        (RIG, {"kind": "track", **FORCES}, ("3 of 3", "0.005 s", "0.02 s")),
        (RIG, {"kind": "track", "shape": "step", "dwell_s": 0.005}, ("0.005 s", "0.02 s")),
        (TWO_ARMS, {"kind": "track", "force": FORCES}, ("3 of 3", "0.005 s")),
        (TWO_ARMS, {"kind": "track", "place": PLACES}, ("3 of 3", "0.005 s")),
        (RIG, {"kind": "grip", "hold_s": 0.005}, ("hold", "0.005 s", "0.02 s")),
        (RIG, {"kind": "hold", "hold_s": 0.005}, ("hold", "0.005 s", "0.02 s")),
    ],
)
def test_points_between_two_samples_are_named(
    rig: RigFile, wish: dict[str, Any], numbers: tuple[str, ...]
) -> None:
    lines = warnings(rig, **wish)
    assert all(number in lines for number in numbers), lines


def test_points_a_period_apart_cause_no_warning() -> None:
    for gap_s in (RIG.rig.period_s, 0.1):
        lines = warnings(kind="track", shape="waypoints", points=points(gap_s))
        assert "period" not in lines
