"""A paused job: it rests at a safe point, and every event there has a defined end."""

from collections.abc import Callable

import pytest

from pincette.config import RigFile

from .canned import IN_APPROACH, IN_HOLD
from .harness import Harness


def paused(harness: Harness, place: int = IN_HOLD, **wishes: object) -> str:
    """Return a paused job."""
    job = harness.playing_to(place, **wishes)
    harness.acted(job, "pause")
    harness.reach(job, "paused")
    return job


def states(harness: Harness, job: str) -> list[str]:
    return [row.body["state"] for row in harness.told("state", job=job)]


def test_a_pause_rests_and_a_resume_continues_to_the_end(harness: Harness) -> None:
    job = paused(harness)
    view = harness.get(f"/jobs/{job}")
    assert view["allowed_actions"] == ["resume", "stop", "abort", "release"]
    assert view["progress"]["paused"] is True
    harness.bus.pause_at = IN_HOLD + 20
    harness.acted(job, "resume")
    harness.reach(job, "running")
    harness.bus.play()
    ended = harness.ended(job)
    assert (ended["state"], ended["cause"]) == ("succeeded", "")
    assert [(a["type"], a["seq"]) for a in ended["actions"]] == [
        ("pause", IN_HOLD),
        ("resume", IN_HOLD + 1),
    ]
    assert all(action["applied_at"] for action in ended["actions"])
    assert harness.bus.acts == ["pause", "resume"]
    assert states(harness, job)[3:] == [
        "running",
        "pausing",
        "paused",
        "resuming",
        "running",
        "succeeded",
    ]


def test_a_pause_acts_only_at_a_safe_point_and_can_be_cancelled(harness: Harness) -> None:
    harness.bus.rests = False
    job = harness.playing_to(IN_APPROACH)
    assert harness.acted(job, "pause")["state"] == "pausing"
    harness.until(lambda: harness.bus.acts == ["pause"])
    assert harness.act(job, "pause").status_code == 200
    harness.bus.pause_at = None
    harness.acted(job, "resume")
    ended = harness.ended(job)
    assert ended["state"] == "succeeded"
    assert "paused" not in states(harness, job)
    (pause, resume) = ended["actions"]
    assert (pause["seq"], resume["seq"]) == (None, IN_APPROACH)


@pytest.mark.parametrize("action", ["pause", "stop", "resume"])
def test_a_controller_that_ignores_an_action_is_tripped_after_the_deadline(
    rig_file: RigFile, open_harness: Callable[..., Harness], action: str
) -> None:
    clock = Clock()
    harness = open_harness(rig_file, clock=clock.read, guard_s=1e6)
    job = paused(harness) if action == "resume" else harness.playing_to(IN_HOLD)
    harness.bus.deaf = True
    harness.acted(job, action)
    harness.until(lambda: harness.bus.acts[-1:] == [action])
    clock.now_s += 200.0
    ended = harness.ended(job)
    assert ended["state"] == "failed"
    assert "took too long" in ended["cause"]
    assert (harness.bus.trips[0].cause, bool(harness.bus.trips[0].words)) == ("supervisor", True)


def test_a_paused_job_has_no_deadline(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    clock = Clock()
    harness = open_harness(rig_file, clock=clock.read, guard_s=1e6)
    job = paused(harness)
    before = harness.get(f"/jobs/{job}")["progress"]
    clock.now_s += 3600.0
    harness.bus.rest()
    harness.until(lambda: harness.get(f"/jobs/{job}")["progress"]["seq"] > before["seq"])
    after = harness.get(f"/jobs/{job}")
    assert after["state"] == "paused"
    assert after["progress"]["remaining_s"] == before["remaining_s"]
    assert after["progress"]["percent"] == before["percent"]
    harness.bus.pause_at = None
    harness.acted(job, "resume")
    assert harness.ended(job)["state"] == "succeeded"


class Clock:
    """A clock that a test advances."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def read(self) -> float:
        return self.now_s
