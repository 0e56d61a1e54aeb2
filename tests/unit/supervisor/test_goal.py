"""Check of a job's goal: the largest permitted distance from its references."""

from typing import Any

import pytest

from pincette.records.columns import columns
from pincette_supervisor.plugin.goal import PAST_HIDES_MN, goal_of
from tests.support.arms import with_arm

from . import samples
from .harness import Harness
from .samples import FORCE_ERROR_MN, PERIOD_S, Tick

SWING_UM = 0.03
"""Amplitude of the prepared position's error, in µm."""


def goal(ticks: list[Tick], **values: float) -> Any:
    table = columns([m for tick in ticks for m in tick.messages()], PERIOD_S)
    return goal_of(table, {"settling_s": 0.5, **values}, "hold", PERIOD_S)


def off_at(tick: int, more_mN: float) -> list[Tick]:
    """A grip whose force is further off at one tick of its hold."""
    ticks = samples.grip()
    first = next(i for i, one in enumerate(ticks) if one.telemetry.phase == "hold")
    one = ticks[first + tick]
    far = with_arm(one.estimate, force_mN=one.estimate.arms[0].force_mN + more_mN)
    ticks[first + tick] = replace_tick(one, far)
    return ticks


def replace_tick(tick: Tick, estimate: Any) -> Tick:
    return Tick(tick.position, estimate, tick.command, tick.telemetry, tick.applied, tick.truth)


def test_errors_within_their_tolerances_meet_the_goal() -> None:
    found = goal(samples.grip(), position_tolerance_um=0.1, force_tolerance_mN=0.3)
    assert found.met
    assert found.settled_s == 0.0
    assert found.force_error_mN == pytest.approx(FORCE_ERROR_MN)
    assert found.position_error_um == pytest.approx(SWING_UM, rel=0.05)


def test_an_error_beyond_its_tolerance_misses_the_goal() -> None:
    found = goal(samples.grip(), position_tolerance_um=0.1, force_tolerance_mN=0.2)
    assert not found.met
    assert found.settled_s is None
    assert found.force_error_mN == pytest.approx(FORCE_ERROR_MN)


def test_errors_while_settling_are_allowed_and_the_settling_time_is_reported() -> None:
    found = goal(off_at(10, 5.0), force_tolerance_mN=0.3)
    assert found.met
    assert found.settled_s == pytest.approx(11 * PERIOD_S)
    assert found.position_error_um is None
    late = goal(off_at(40, 5.0), force_tolerance_mN=0.3)
    assert not late.met
    assert late.settled_s == pytest.approx(41 * PERIOD_S)
    assert late.force_error_mN == pytest.approx(5.0 + FORCE_ERROR_MN)


def test_a_hold_that_ended_before_it_could_settle_misses_the_goal() -> None:
    short = [tick for tick in samples.grip() if tick.telemetry.phase != "hold"]
    assert goal(short, force_tolerance_mN=0.3).met is False
    assert goal(samples.grip(), force_tolerance_mN=0.3, settling_s=60.0).met is False


def test_without_a_tolerance_there_is_no_verdict() -> None:
    assert goal(samples.grip()) is None


def test_a_job_states_the_verdict_and_its_event_too(harness: Harness) -> None:
    job = harness.grip(force_tolerance_mN=0.2, settling_s=0.4)
    assert job["values"]["force_tolerance_mN"] == 0.2
    ended = harness.ended(job["id"])
    assert ended["state"] == "succeeded"
    assert ended["result"]["goal"]["met"] is False
    harness.until(lambda: bool(harness.told("result")))
    assert harness.told("result")[0].body["goal_met"] is False
    assert (
        "goal missed" in (harness.manager.context.records / job["id"] / "report.html").read_text()
    )


@pytest.mark.parametrize(
    ("body", "member"),
    [
        ({"kind": "grip", "settling_s": 1.0}, "position_tolerance_um"),
        ({"kind": "grip", "force_tolerance_mN": 0.0}, "force_tolerance_mN"),
        ({"kind": "move", "to_V": 1.0, "position_tolerance_um": 0.1}, "to_um"),
        ({"kind": "move", "to_um": 1.0, "force_tolerance_mN": 0.1}, "force_tolerance_mN"),
    ],
)
def test_a_goal_without_a_criterion_that_can_be_checked_is_refused(
    harness: Harness, body: dict[str, Any], member: str
) -> None:
    response = harness.post("/jobs", body)
    assert response.status_code == 422
    assert member in response.text


@pytest.mark.parametrize("why", [{"settling_s": 60.0}, {"settling_s": 0.5, PAST_HIDES_MN: 0.4}])
def test_a_completed_phase_too_short_or_with_an_unknown_past_is_not_judged(
    why: dict[str, float],
) -> None:
    table = columns([m for tick in samples.grip() for m in tick.messages()], PERIOD_S)
    values = {**why, "force_tolerance_mN": 0.3}
    found = goal_of(table, values, "hold", PERIOD_S, completed=True)
    assert found is not None
    assert found.met is None
    assert found.settled_s == 0.0
    ended_early = goal_of(table, {**values, "settling_s": 60.0}, "hold", PERIOD_S)
    assert ended_early is not None
    assert ended_early.met is False
