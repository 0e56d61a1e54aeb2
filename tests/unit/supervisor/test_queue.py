"""Jobs that wait for the running one."""

from collections.abc import Callable
from typing import Any

import pytest

from pincette.config import RigFile
from pincette_supervisor.jobs.job_queue import CAPACITY, RESTARTED
from pincette_supervisor.journal.store import utc_now
from pincette_supervisor.plugin import Planned

from .canned import IN_APPROACH, IN_HOLD
from .harness import Harness, ending

GRIP = {"kind": "grip", "autostart": True, "queue": True}


def queued(harness: Harness, **wishes: Any) -> dict[str, Any]:
    response = harness.post("/jobs", {**GRIP, **wishes})
    assert response.status_code == 201, response.text
    return response.json()


def order(harness: Harness, what: str) -> Any:
    return harness.call(
        "POST",
        "/api/v1/rigs/demo/queue/actions",
        json={"type": what},
        headers={"X-Operator": "Ada"},
    )


def test_a_queued_job_starts_when_the_previous_one_has_succeeded(harness: Harness) -> None:
    first = harness.playing_to(IN_HOLD, queue=True)
    second, third = queued(harness), queued(harness)
    assert (second["state"], second["position"], third["position"]) == ("queued", 1, 2)
    assert second["allowed_actions"] == ["stop", "abort"]
    assert harness.get("/rigs/demo")["queue"] == {
        "length": 2,
        "halted": "",
        "capacity": CAPACITY,
        "proposed": 0,
    }
    assert harness.post("/jobs", {"kind": "grip"}).json()["type"].endswith("job-active")
    harness.bus.pause_at = None
    harness.bus.play()
    assert harness.ended(first)["state"] == "succeeded"
    assert harness.ended(second["id"])["state"] == "succeeded"
    assert harness.ended(third["id"])["state"] == "succeeded"
    lengths = [row.body["length"] for row in harness.told("queue")]
    assert lengths == [1, 2, 1, 0]


def test_a_job_that_does_not_succeed_halts_the_queue_until_a_person_resumes_it(
    harness: Harness,
) -> None:
    first = harness.playing_to(IN_APPROACH)
    second = queued(harness)["id"]
    harness.acted(first, "stop")
    assert harness.freed(first)["state"] == "stopped"
    view = harness.get("/rigs/demo")
    assert view["queue"]["halted"].startswith(f"job {first} stopped")
    assert {"resume_queue", "clear_queue"} <= set(view["allowed_actions"])
    assert harness.get(f"/jobs/{second}")["state"] == "queued"
    harness.bus.pause_at = None
    assert order(harness, "resume").json()["queue"]["halted"] == ""
    assert harness.ended(second)["state"] == "succeeded"
    assert harness.told("queue")[-1].body["by"] == "Ada"


def test_a_queue_is_not_resumed_while_the_rig_is_latched(harness: Harness) -> None:
    first = harness.playing_to(IN_APPROACH)
    second = queued(harness)["id"]
    harness.acted(first, "abort")
    harness.freed(first)
    assert order(harness, "resume").status_code == 409
    assert harness.get(f"/jobs/{second}")["state"] == "queued"
    assert order(harness, "clear").json()["queue"]["length"] == 0
    cleared = harness.get(f"/jobs/{second}")
    assert (cleared["state"], cleared["ending"]["code"]) == ("stopped", "queue_cleared")
    assert cleared["cause"] == "the queue was cleared"


def test_a_queued_job_can_be_stopped_and_the_others_move_up(harness: Harness) -> None:
    harness.playing_to(IN_HOLD)
    second, third = queued(harness), queued(harness)
    stopped = harness.acted(second["id"], "stop")
    assert (stopped["state"], stopped["position"]) == ("stopped", None)
    assert stopped["actions"][0]["applied_at"]
    moved = harness.get(f"/jobs/{third['id']}")
    assert moved["position"] == 1
    assert moved["revision"] > third["revision"]
    assert harness.act(third["id"], "start").json()["allowed_actions"] == ["stop", "abort"]


def test_a_job_is_planned_again_at_its_turn_and_fails_without_a_plan(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_plan(*_given: object) -> Planned:
        raise ValueError("contact_um = 90 µm is out of reach")

    first = harness.playing_to(IN_HOLD)
    second, third = queued(harness)["id"], queued(harness)["id"]
    monkeypatch.setattr("pincette_supervisor.planning.job_plans.plan", no_plan)
    harness.bus.play()
    assert harness.ended(first)["state"] == "succeeded"
    harness.ended(second)
    failed = harness.freed(second)
    assert (failed["state"], failed["cause"]) == ("failed", "contact_um = 90 µm is out of reach")
    assert failed["ending"] == ending("plan_refused", problem="invalid-request")
    assert harness.get(f"/jobs/{third}")["state"] == "queued"
    assert harness.get("/rigs/demo")["queue"]["halted"].startswith(f"job {second} failed: ")


def test_the_queue_has_a_maximum_length(harness: Harness) -> None:
    harness.playing_to(IN_HOLD)
    for _ in range(CAPACITY):
        queued(harness)
    refused = harness.post("/jobs", GRIP)
    assert refused.status_code == 409
    assert refused.json()["type"].endswith("queue-full")


def test_the_queue_survives_a_restart_and_waits_for_a_person(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    first = harness.playing_to(IN_APPROACH)
    second = queued(harness, labels={"part": "bead"})["id"]
    harness.manager.close()
    after = open_harness(rig_file)
    after.health.refresh()
    after.manager.recover(after.store.interrupt_unfinished(utc_now()))
    assert after.get(f"/jobs/{first}")["state"] == "interrupted"
    waiting = after.get(f"/jobs/{second}")
    assert (waiting["state"], waiting["position"]) == ("queued", 1)
    assert after.get("/rigs/demo")["queue"]["halted"] == RESTARTED
    assert after.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    assert order(after, "resume").status_code == 200
    ended = after.ended(second)
    assert (ended["state"], ended["labels"]) == ("succeeded", {"part": "bead"})


def test_a_queue_is_not_resumed_while_a_part_is_held_and_no_job_is_lost(harness: Harness) -> None:
    first = harness.playing_to(IN_HOLD)
    second = queued(harness)["id"]
    harness.acted(first, "stop")
    harness.ended(first)
    refused = order(harness, "resume")
    assert refused.status_code == 409
    assert refused.json()["type"].endswith("part-held")
    assert harness.get(f"/jobs/{second}")["state"] == "queued"
    harness.bus.pause_at = None
    harness.acted(first, "release")
    harness.freed(first)
    assert harness.get(f"/jobs/{second}")["state"] == "queued"
    assert order(harness, "resume").status_code == 200
    assert harness.ended(second)["state"] == "succeeded"


def test_an_emergency_stop_between_two_jobs_keeps_the_queued_job(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = harness.playing_to(IN_HOLD)
    second = queued(harness)["id"]
    next_entry = harness.manager.queue.next

    def stopped_before() -> Any:
        if not harness.bus.latch:
            harness.bus.trip("estop: an emergency stop was requested")
        return next_entry()

    with monkeypatch.context() as between:
        between.setattr(harness.manager.queue, "next", stopped_before)
        harness.bus.play()
        assert harness.freed(first)["state"] == "succeeded"
    assert harness.get(f"/jobs/{second}")["state"] == "queued"
    assert "latched" in harness.get("/rigs/demo")["queue"]["halted"]
    harness.bus.pause_at = None
    assert harness.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    assert order(harness, "resume").status_code == 200
    assert harness.ended(second)["state"] == "succeeded"


def waiting(harness: Harness) -> list[str]:
    """Return the names of the waiting jobs, the next first."""
    found = [job for job in harness.get("/jobs", state="queued")["jobs"] if job["position"]]
    return [job["id"] for job in sorted(found, key=lambda job: job["position"])]


def moved(harness: Harness, job: str, position: int) -> Any:
    body = {"type": "move", "job": job, "position": position}
    return harness.post("/rigs/demo/queue/actions", body)


def test_the_order_of_the_queue_is_by_priority_and_can_be_changed(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    harness.playing_to(IN_HOLD)
    second, third = queued(harness)["id"], queued(harness)["id"]
    urgent = queued(harness, priority=5)
    assert urgent["position"] == 1
    assert waiting(harness) == [urgent["id"], second, third]
    before = harness.get(f"/jobs/{third}")["revision"]
    assert moved(harness, third, 1).status_code == 200
    assert waiting(harness) == [third, urgent["id"], second]
    assert harness.get(f"/jobs/{third}")["revision"] > before
    assert moved(harness, third, 99).status_code == 200
    assert waiting(harness) == [urgent["id"], second, third]
    assert moved(harness, "none", 1).status_code == 404
    assert harness.told("queue")[-1].body["by"]
    after = open_harness(rig_file)
    after.manager.recover([])
    assert waiting(after) == [urgent["id"], second, third]
