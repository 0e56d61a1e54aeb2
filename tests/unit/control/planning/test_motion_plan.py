"""Moves, holds and releases as programs: their segments, durations, and broken limits."""

from dataclasses import replace
from typing import Any

import pytest

from pincette.control.planning.contact_plan import MotionPlan
from pincette.control.planning.motion_plan import (
    Cycles,
    MoveRequest,
    StartPosition,
    plan_hold,
    plan_move,
    plan_release,
)
from pincette.control.planning.segments import Drive, Move, Ramp, paths_of

from .bench import RIG as BENCH

RIG = replace(BENCH, piezo_um_per_V=20.0, compliance_um_per_mN=0.5)
REST, AWAY = StartPosition(0.0, 0.0), StartPosition(10.0, 0.5)
POINTERS = {
    "move": "/target",
    "move slew": "/speed",
    "condition": "/high_V",
    "unload slew": "/time",
}


def moved(stand: StartPosition = REST, **wishes: Any) -> MotionPlan:
    values: dict[str, Any] = {"speed_um_per_s": 20.0, "contact_force_mN": 2.0, **wishes}
    return plan_move(MoveRequest(**values), RIG, stand, POINTERS)


def test_a_move_to_a_position_is_smooth_and_ends_at_rest() -> None:
    plan = moved(AWAY, to_um=30.0, zero_s=0.4)
    assert [(segment.phase, type(segment)) for segment in plan.program.segments] == [
        ("zero", Drive),
        ("move", Move),
        ("rest", Move),
    ]
    # The quintic's peak speed is 15/8 of its mean.
    assert plan.phases[1].duration_s == pytest.approx(15 / 8 * 20.0 / 20.0)
    assert plan.violations == ()
    assert (plan.course.x_r_um[0], plan.course.voltage_V[0]) == (10.0, 0.5)
    assert plan.course.x_r_um[-1] == pytest.approx(30.0)
    assert plan.course.voltage_V[-1] == pytest.approx(1.5)
    assert not plan.program.begins_held
    assert not plan.program.guards.zero_needed
    assert [segment.guarded for segment in plan.program.segments] == [True, True, True]


@pytest.mark.parametrize("wish", [{"to_V": 1.0}, {"by_V": 0.5}])
def test_a_move_to_a_voltage_uses_no_law(wish: dict[str, float]) -> None:
    plan = moved(AWAY, **wish)
    assert all(segment.open_loop for segment in plan.program.segments)
    assert plan.course.voltage_V[-1] == pytest.approx(1.0)
    assert plan.course.x_r_um[-1] == pytest.approx(20.0)
    move = plan.program.segments[0]
    # A change starts from the voltage applied when it is played, whatever the plan began from.
    assert any(path.relative for path in paths_of(move)) == ("by_V" in wish)


def test_cycles_precede_the_move_and_end_at_their_lowest_voltage() -> None:
    cycles = Cycles(low_V=-0.5, high_V=2.0, rate_V_per_s=3.0, count=2, warm_up_s=20.0)
    plan = moved(AWAY, to_um=5.0, zero_s=0.4, cycles=cycles)
    names = [phase.phase for phase in plan.phases]
    assert names == ["zero", *["warm up"] * 2, *["condition"] * 2, "zero", "move", "rest"]
    (warm,), (condition,) = (paths_of(plan.program.segments[number]) for number in (2, 4))
    assert warm is not None
    assert warm.duration_s >= 20.0
    assert condition is not None
    values = [knot.value for knot in condition.knots]
    assert values == [-0.5, 2.0, -0.5, 2.0, -0.5]
    assert plan.phases[4].voltage_V == -0.5
    rates = [
        abs(b - a) / RIG.period_s
        for a, b in zip(plan.course.voltage_V, plan.course.voltage_V[1:], strict=False)
    ]
    assert max(rates) < 3.0 * 1.01
    assert plan.violations == ()


def test_limits_of_voltage_position_and_slew_are_named_with_their_member() -> None:
    broken = {(v.quantity, v.pointer) for v in moved(to_um=90.0).violations}
    assert broken == {("position", "/target"), ("voltage", "/target")}
    (slew,) = moved(to_V=3.0, speed_um_per_s=300.0).violations
    assert (slew.quantity, slew.pointer, slew.limit, slew.unit) == ("slew", "/speed", 10.0, "V/s")
    assert slew.value == pytest.approx(15.0, rel=0.01)
    cycles = Cycles(low_V=0.0, high_V=4.5, rate_V_per_s=3.0, count=1)
    found = moved(to_V=0.0, cycles=cycles).violations
    assert {v.pointer for v in found} == {"/high_V"}
    assert {v.quantity for v in found} == {"voltage", "position"}


@pytest.mark.parametrize("hold_s", [None, 5.0])
def test_a_hold_keeps_the_voltage_and_releases_smoothly(hold_s: float | None) -> None:
    plan = plan_hold(hold_s, 2.0, RIG, StartPosition(39.0, 2.5), 0.0, POINTERS)
    hold, unload = plan.program.segments
    assert hold == Drive("hold", hold_s)
    assert isinstance(unload, Drive)
    assert (unload.phase, unload.courses) == ("unload", (Ramp(0.0),))
    assert plan.program.begins_held
    assert plan.program.guards.position_max_um == 70.0
    assert (plan.course.x_r_um[0], plan.course.voltage_V[0]) == (39.0, 2.5)
    assert (plan.course.x_r_um[-1], plan.course.voltage_V[-1]) == (
        pytest.approx(0.0),
        pytest.approx(0.0),
    )
    assert plan.violations == ()


def test_a_release_faster_than_the_slew_limit_is_reported_as_a_violation() -> None:
    (broken,) = plan_release(0.3, RIG, StartPosition(39.0, 2.5), 0.0, POINTERS).violations
    assert (broken.quantity, broken.pointer) == ("slew", "/time")
    # 15/8 of the mean, from one sample to the next.
    assert broken.value == pytest.approx(-15 / 8 * 2.5 / 0.3, rel=0.01)
    assert plan_release(0.5, RIG, StartPosition(39.0, 2.5), 0.0, POINTERS).violations == ()


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({}, "exactly one target"),
        ({"to_um": 1.0, "by_V": 0.1}, "exactly one target"),
        ({"to_um": 1.0, "speed_um_per_s": 0.0}, "speed_um_per_s"),
    ],
)
def test_impossible_moves_are_refused(wishes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        moved(**wishes)


def test_invalid_cycles_and_times_are_refused() -> None:
    with pytest.raises(ValueError, match="range of the cycles"):
        Cycles(low_V=1.0, high_V=1.0, rate_V_per_s=3.0)
    with pytest.raises(ValueError, match="rate of the cycles"):
        Cycles(low_V=0.0, high_V=1.0, rate_V_per_s=0.0)
    with pytest.raises(ValueError, match="release_s"):
        plan_release(0.0, RIG, REST, 0.0, {})
    with pytest.raises(ValueError, match="hold_s"):
        plan_hold(-1.0, 1.0, RIG, REST, 0.0, {})
    with pytest.raises(ValueError, match="piezoelectric constant"):
        plan_move(
            MoveRequest(speed_um_per_s=1.0, contact_force_mN=2.0, to_V=0.1),
            replace(RIG, piezo_um_per_V=0.0),
            REST,
            {},
        )
