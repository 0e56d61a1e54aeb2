"""Jobs that wait for the one that runs."""

from collections.abc import Callable
from typing import Any

import pytest

from pincette.config import RigFile
from pincette_supervisor.journal.store import utc_now
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.running.job_queue import CAPACITY, RESTARTED

from .canned import IN_APPROACH, IN_HOLD
from .rig import Desk

GRIP = {"kind": "grip", "autostart": True, "queue": True}


def queued(desk: Desk, **wishes: Any) -> dict[str, Any]:
    response = desk.post("/jobs", {**GRIP, **wishes})
    assert response.status_code == 201, response.text
    return response.json()


def order(desk: Desk, what: str) -> Any:
    return desk.call(
        "POST",
        "/api/v1/rigs/demo/queue/actions",
        json={"type": what},
        headers={"X-Operator": "Ada"},
    )


def test_a_queued_job_begins_when_the_one_before_has_succeeded(desk: Desk) -> None:
    first = desk.playing_to(IN_HOLD, queue=True)
    second, third = queued(desk), queued(desk)
    assert (second["state"], second["position"], third["position"]) == ("queued", 1, 2)
    assert second["allowed_actions"] == ["stop", "abort"]
    assert desk.get("/rigs/demo")["queue"] == {"length": 2, "halted": "", "capacity": CAPACITY}
    assert desk.post("/jobs", {"kind": "grip"}).json()["type"].endswith("job-active")
    desk.bus.pause_at = None
    desk.bus.play()
    assert desk.ended(first)["state"] == "succeeded"
    assert desk.ended(second["id"])["state"] == "succeeded"
    assert desk.ended(third["id"])["state"] == "succeeded"
    lengths = [row.body["length"] for row in desk.told("queue")]
    assert lengths == [1, 2, 1, 0]


def test_a_job_that_ends_otherwise_halts_the_queue_until_a_person_resumes_it(desk: Desk) -> None:
    first = desk.playing_to(IN_APPROACH)
    second = queued(desk)["id"]
    desk.acted(first, "stop")
    assert desk.freed(first)["state"] == "stopped"
    view = desk.get("/rigs/demo")
    assert view["queue"]["halted"].startswith(f"job {first} stopped")
    assert {"resume_queue", "clear_queue"} <= set(view["allowed_actions"])
    assert desk.get(f"/jobs/{second}")["state"] == "queued"
    desk.bus.pause_at = None
    assert order(desk, "resume").json()["queue"]["halted"] == ""
    assert desk.ended(second)["state"] == "succeeded"
    assert desk.told("queue")[-1].body["by"] == "Ada"


def test_a_queue_is_not_resumed_while_the_rig_is_latched(desk: Desk) -> None:
    first = desk.playing_to(IN_APPROACH)
    second = queued(desk)["id"]
    desk.acted(first, "abort")
    desk.freed(first)
    assert order(desk, "resume").status_code == 409
    assert desk.get(f"/jobs/{second}")["state"] == "queued"
    assert order(desk, "clear").json()["queue"]["length"] == 0
    cleared = desk.get(f"/jobs/{second}")
    assert (cleared["state"], cleared["cause"]) == ("stopped", "the queue was cleared")


def test_a_queued_job_is_stopped_before_its_turn_and_the_others_move_up(desk: Desk) -> None:
    desk.playing_to(IN_HOLD)
    second, third = queued(desk), queued(desk)
    stopped = desk.acted(second["id"], "stop")
    assert (stopped["state"], stopped["position"]) == ("stopped", None)
    assert stopped["actions"][0]["applied_at"]
    moved = desk.get(f"/jobs/{third['id']}")
    assert moved["position"] == 1
    assert moved["revision"] > third["revision"]
    assert desk.act(third["id"], "start").json()["allowed_actions"] == ["stop", "abort"]


def test_a_job_whose_turn_has_come_is_planned_again_and_fails_where_there_is_no_plan(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_plan(*_given: object) -> Planned:
        raise ValueError("contact_um = 90 µm is out of reach")

    first = desk.playing_to(IN_HOLD)
    second, third = queued(desk)["id"], queued(desk)["id"]
    monkeypatch.setattr("pincette_supervisor.running.planner.plan_with_recipe", no_plan)
    desk.bus.play()
    assert desk.ended(first)["state"] == "succeeded"
    desk.ended(second)
    failed = desk.freed(second)
    assert (failed["state"], failed["cause"]) == ("failed", "contact_um = 90 µm is out of reach")
    assert desk.get(f"/jobs/{third}")["state"] == "queued"
    assert desk.get("/rigs/demo")["queue"]["halted"].startswith(f"job {second} failed: ")


def test_the_queue_has_an_end(desk: Desk) -> None:
    desk.playing_to(IN_HOLD)
    for _ in range(CAPACITY):
        queued(desk)
    refused = desk.post("/jobs", GRIP)
    assert refused.status_code == 409
    assert refused.json()["type"].endswith("queue-full")


def test_the_queue_survives_a_restart_and_waits_for_a_person(
    desk: Desk, rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    first = desk.playing_to(IN_APPROACH)
    second = queued(desk, labels={"part": "bead"})["id"]
    desk.conductor.close()
    after = open_desk(rig_file)
    after.health.refresh()
    after.conductor.recover(after.store.interrupt_left_over(utc_now()))
    assert after.get(f"/jobs/{first}")["state"] == "interrupted"
    waiting = after.get(f"/jobs/{second}")
    assert (waiting["state"], waiting["position"]) == ("queued", 1)
    assert after.get("/rigs/demo")["queue"]["halted"] == RESTARTED
    assert after.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200
    assert order(after, "resume").status_code == 200
    ended = after.ended(second)
    assert (ended["state"], ended["labels"]) == ("succeeded", {"part": "bead"})
