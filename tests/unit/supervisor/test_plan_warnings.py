"""What plans say of weak forces, goals that will not be judged, and unsampled paths."""

from typing import Any

import pytest

from pincette.cli import opened
from pincette.config import RigFile
from pincette_supervisor.kinds.bodies import REQUEST
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.planning.present import Present
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
        (TWO_ARMS, {"kind": "pair_grip", "force_mN": 0.5}, "/force_mN"),
        (TWO_ARMS, {"kind": "centre", "force_mN": 0.5}, "/force_mN"),
        (TWO_ARMS, {"kind": "pair_track", "force": WEAK_LEVELS}, "/force"),
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
        {"kind": "grip", "hold_s": 2.0, "force_tolerance_mN": 0.1, "settling_s": 3.0},
        {"kind": "move", "to_um": 5.0, "position_tolerance_um": 0.1, "settling_s": 0.6},
    ],
)
def test_a_goal_that_will_not_be_judged_is_named_in_the_plan(wish: dict[str, Any]) -> None:
    assert planned(**wish).plan.feasible
    assert "settling_s" in warnings(**wish)


@pytest.mark.parametrize(
    "wish",
    [
        {"kind": "grip", "hold_s": 2.0, "force_tolerance_mN": 0.1},
        {"kind": "grip", "hold_s": 0.3},
        {"kind": "grip", "until_released": True, "force_tolerance_mN": 0.1},
        {"kind": "move", "to_um": 5.0, "position_tolerance_um": 0.1},
    ],
)
def test_a_goal_that_can_be_judged_brings_no_warning(wish: dict[str, Any]) -> None:
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
        (TWO_ARMS, {"kind": "pair_track", "force": FORCES}, ("3 of 3", "0.005 s")),
        (TWO_ARMS, {"kind": "pair_track", "place": PLACES}, ("3 of 3", "0.005 s")),
        (RIG, {"kind": "grip", "hold_s": 0.005}, ("hold", "0.005 s", "0.02 s")),
        (RIG, {"kind": "hold", "hold_s": 0.005}, ("hold", "0.005 s", "0.02 s")),
    ],
)
def test_what_lies_between_two_samples_is_named(
    rig: RigFile, wish: dict[str, Any], numbers: tuple[str, ...]
) -> None:
    told = warnings(rig, **wish)
    assert all(number in told for number in numbers), told


def test_points_a_period_apart_bring_no_warning() -> None:
    for gap_s in (RIG.rig.period_s, 0.1):
        told = warnings(kind="track", shape="waypoints", points=points(gap_s))
        assert "period" not in told
