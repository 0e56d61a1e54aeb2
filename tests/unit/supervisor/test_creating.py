"""Creating a job once, asking for it again, and finding it among others."""

import asyncio
from typing import Any

import httpx
import pytest

from .canned import IN_APPROACH
from .rig import Desk

GRIP = {"kind": "grip", "autostart": True}


def create(desk: Desk, key: str, body: dict[str, Any] = GRIP, path: str = "/jobs") -> Any:
    headers = {"Idempotency-Key": key}
    return desk.call("POST", f"/api/v1{path}", json=body, headers=headers)


def ask(desk: Desk, job: str, tag: str, **query: Any) -> httpx.Response:
    headers = {"If-None-Match": tag}
    return desk.call("GET", f"/api/v1/jobs/{job}", params=query, headers=headers)


def test_the_same_key_and_request_create_one_job(desk: Desk) -> None:
    first = create(desk, "cell 4, part 17")
    assert first.status_code == 201
    assert "idempotency-replayed" not in first.headers
    again = create(desk, "cell 4, part 17")
    assert again.status_code == 200
    assert again.headers["idempotency-replayed"] == "true"
    assert again.json()["id"] == first.json()["id"]
    assert again.headers["location"] == first.headers["location"]
    assert len(desk.get("/jobs")["jobs"]) == 1


def test_a_key_is_for_one_request(desk: Desk) -> None:
    job = create(desk, "k").json()["id"]
    other = create(desk, "k", {**GRIP, "force_mN": 12.0})
    assert other.status_code == 422
    assert other.json()["type"].endswith("idempotency-key-reused")
    assert other.json()["job"] == job


def test_a_calibration_is_created_once_too(desk: Desk) -> None:
    body = {"calibration": "noise"}
    first = create(desk, "n", body, "/calibrations")
    again = create(desk, "n", {**body, "kind": "calibrate"}, "/jobs")
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json()["id"] == again.json()["id"]


@pytest.mark.parametrize("key", ["", "x" * 256, "tab\there"])
def test_a_key_has_a_length_and_can_be_printed(desk: Desk, key: str) -> None:
    assert create(desk, key).status_code == 422
    assert desk.get("/jobs")["jobs"] == []


def test_an_etag_says_whether_a_job_has_changed(desk: Desk) -> None:
    job = desk.playing_to(IN_APPROACH)
    response = desk.call("GET", f"/api/v1/jobs/{job}")
    tag = response.headers["etag"]
    assert tag == f'W/"{job}-{response.json()["revision"]}"'
    desk.bus.play(IN_APPROACH + 5)
    live = desk.conductor.active
    assert live is not None
    desk.until(lambda: live.progress is not None and live.progress.seq == IN_APPROACH + 4)
    unchanged = ask(desk, job, tag)
    assert (unchanged.status_code, unchanged.headers["etag"]) == (304, tag)
    assert ask(desk, job, tag, wait="change", timeout_s=0.01).status_code == 304
    desk.acted(job, "stop")
    changed = ask(desk, job, tag, wait="change", timeout_s=20)
    assert changed.status_code == 200
    assert changed.json()["revision"] > response.json()["revision"]


def test_a_long_poll_by_revision_answers_with_the_next_change(desk: Desk) -> None:
    taken = desk.post("/jobs", {"kind": "grip"}).json()
    desk.reach(taken["id"], "ready")
    ready = desk.get(f"/jobs/{taken['id']}", wait="change", since=taken["revision"])
    assert ready["state"] == "ready"
    as_it_is = desk.get(
        f"/jobs/{taken['id']}", wait="change", since=ready["revision"], timeout_s=0.01
    )
    assert as_it_is == ready

    async def poll() -> httpx.Response:
        transport = httpx.ASGITransport(desk.app)
        base = "http://localhost/api/v1"
        async with httpx.AsyncClient(transport=transport, base_url=base) as client:
            query = {"wait": "change", "since": ready["revision"], "timeout_s": 30}
            waiting = asyncio.create_task(client.get(f"/jobs/{taken['id']}", params=query))
            await client.post(f"/jobs/{taken['id']}/actions", json={"type": "stop"})
            return await waiting

    assert asyncio.run(poll()).json()["revision"] > ready["revision"]


def test_an_action_is_kept_with_who_asked_and_when_it_acted(desk: Desk) -> None:
    job = desk.playing_to(IN_APPROACH)
    assert desk.act(job, "stop", headers={"X-Operator": "x" * 81}).status_code == 422
    desk.act(job, "stop", headers={"X-Operator": "Ada, cell 4"})
    (action,) = desk.ended(job)["actions"]
    assert (action["by"], action["seq"]) == ("Ada, cell 4", IN_APPROACH)
    assert action["requested_at"] <= action["applied_at"]
    asked, applied = desk.told("action", job=job)[-2:]
    assert (asked.body["by"], asked.body["applied"]) == ("Ada, cell 4", False)
    assert (applied.body["seq"], applied.body["applied"]) == (IN_APPROACH, True)


def test_jobs_are_found_by_what_they_are(desk: Desk) -> None:
    names: list[str] = []
    for number in range(3):
        body = {"kind": "grip", "labels": {"part": f"bead {number}"}}
        job = desk.post("/jobs", body).json()["id"]
        desk.reach(job, "ready")
        desk.acted(job, "stop")
        desk.freed(job)
        names.insert(0, job)

    def found(**query: Any) -> list[str]:
        return [job["id"] for job in desk.get("/jobs", **query)["jobs"]]

    assert found() == names
    assert found(state="stopped", kind="grip", rig="demo") == names
    assert found(state="failed") == found(kind="track") == found(rig="other") == []
    assert found(label="part=bead 1") == [names[1]]
    page = desk.get("/jobs", limit=2)
    assert page["next"] == names[1]
    assert found(limit=2, before=page["next"]) == [names[2]]
    assert desk.get("/jobs", limit=3)["next"] is None
    assert desk.call("GET", "/api/v1/jobs", params={"label": "part"}).status_code == 422
    assert desk.call("GET", "/api/v1/jobs", params={"before": "none"}).status_code == 404
