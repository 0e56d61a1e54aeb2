"""A job that is paused: it rests at a safe point, and whatever befalls it there ends well."""

from collections.abc import Callable

import pytest

from pincette.config import RigFile

from .canned import IN_APPROACH, IN_HOLD
from .rig import Desk


def paused(desk: Desk, place: int = IN_HOLD, **wishes: object) -> str:
    """A job that is paused."""
    job = desk.playing_to(place, **wishes)
    desk.acted(job, "pause")
    desk.reach(job, "paused")
    return job


def states(desk: Desk, job: str) -> list[str]:
    return [row.body["state"] for row in desk.told("state", job=job)]


def test_a_pause_rests_and_a_resume_goes_on_to_the_end(desk: Desk) -> None:
    job = paused(desk)
    view = desk.get(f"/jobs/{job}")
    assert view["allowed_actions"] == ["resume", "stop", "abort", "release"]
    assert view["progress"]["paused"] is True
    desk.bus.pause_at = IN_HOLD + 20
    desk.acted(job, "resume")
    desk.reach(job, "running")
    desk.bus.play()
    ended = desk.ended(job)
    assert (ended["state"], ended["cause"]) == ("succeeded", "")
    assert [(a["type"], a["seq"]) for a in ended["actions"]] == [
        ("pause", IN_HOLD),
        ("resume", IN_HOLD + 1),
    ]
    assert all(action["applied_at"] for action in ended["actions"])
    assert desk.bus.acts == ["pause", "resume"]
    assert states(desk, job)[3:] == [
        "running",
        "pausing",
        "paused",
        "resuming",
        "running",
        "succeeded",
    ]


def test_a_pause_comes_only_at_a_safe_point_and_can_be_taken_back(desk: Desk) -> None:
    desk.bus.rests = False
    job = desk.playing_to(IN_APPROACH)
    assert desk.acted(job, "pause")["state"] == "pausing"
    desk.until(lambda: desk.bus.acts == ["pause"])
    assert desk.act(job, "pause").status_code == 200
    desk.bus.pause_at = None
    desk.acted(job, "resume")
    ended = desk.ended(job)
    assert ended["state"] == "succeeded"
    assert "paused" not in states(desk, job)
    (pause, resume) = ended["actions"]
    assert (pause["seq"], resume["seq"]) == (None, IN_APPROACH)


def test_a_stop_of_a_pause_asks_for_the_stop_alone_and_keeps_the_part(desk: Desk) -> None:
    job = paused(desk)
    desk.acted(job, "stop")
    stopped = desk.ended(job)
    assert stopped["state"] == "stopped"
    assert desk.bus.acts == ["pause", "stop"]
    assert "running" not in states(desk, job)[4:]
    assert stopped["allowed_actions"] == ["release", "abort"]


def test_a_release_from_a_pause_lets_the_part_go(desk: Desk) -> None:
    job = paused(desk)
    desk.bus.pause_at = None
    desk.acted(job, "release")
    ended = desk.ended(job)
    assert ended["state"] == "succeeded"
    assert desk.bus.acts == ["pause", "release"]


def test_a_trip_of_a_pause_fails_the_job_with_its_cause(desk: Desk) -> None:
    job = paused(desk)
    desk.bus.trip("device: no answer")
    ended = desk.ended(job)
    assert (ended["state"], ended["cause"]) == ("failed", "actuator tripped: device: no answer")
    assert [row.body["cause"] for row in desk.told("alarm", job=job)] == ["device: no answer"]


def test_a_part_that_is_lost_in_a_pause_ends_the_job(desk: Desk) -> None:
    job = paused(desk)
    desk.bus.lose()
    ended = desk.ended(job)
    assert ended["state"] == "failed"
    assert ended["cause"].startswith("lost: ")


def test_an_abort_of_a_pause_trips_the_actuator(desk: Desk) -> None:
    job = paused(desk)
    desk.acted(job, "abort")
    assert desk.ended(job)["state"] == "aborted"
    assert {trip.cause for trip in desk.bus.trips} == {"abort"}


@pytest.mark.parametrize("action", ["pause", "stop", "resume"])
def test_a_controller_that_does_nothing_is_tripped_when_the_time_is_over(
    rig_file: RigFile, open_desk: Callable[..., Desk], action: str
) -> None:
    clock = Clock()
    desk = open_desk(rig_file, clock=clock.read, guard_s=1e6)
    job = paused(desk) if action == "resume" else desk.playing_to(IN_HOLD)
    desk.bus.deaf = True
    desk.acted(job, action)
    desk.until(lambda: desk.bus.acts[-1:] == [action])
    clock.now_s += 200.0
    ended = desk.ended(job)
    assert ended["state"] == "failed"
    assert "took too long" in ended["cause"]
    assert desk.bus.trips[0].cause.startswith("supervisor: ")


def test_no_deadline_runs_while_a_job_is_paused(
    rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    clock = Clock()
    desk = open_desk(rig_file, clock=clock.read, guard_s=1e6)
    job = paused(desk)
    before = desk.get(f"/jobs/{job}")["progress"]
    clock.now_s += 3600.0
    desk.bus.rest()
    desk.until(lambda: desk.get(f"/jobs/{job}")["progress"]["seq"] > before["seq"])
    after = desk.get(f"/jobs/{job}")
    assert after["state"] == "paused"
    assert after["progress"]["remaining_s"] == before["remaining_s"]
    assert after["progress"]["percent"] == before["percent"]
    desk.bus.pause_at = None
    desk.acted(job, "resume")
    assert desk.ended(job)["state"] == "succeeded"


class Clock:
    """A clock that a test turns."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def read(self) -> float:
        return self.now_s
