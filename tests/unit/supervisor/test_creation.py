"""Creating a job once, repeating the request, and finding the job among others."""

import asyncio
import json
from typing import Any
from urllib.parse import unquote

import httpx
import pytest

from .canned import IN_APPROACH
from .harness import Harness

BASE = "http://localhost/api/v1"
GRIP = {"kind": "grip", "autostart": True}


def create(harness: Harness, key: str, body: dict[str, Any] = GRIP, path: str = "/jobs") -> Any:
    headers = {"Idempotency-Key": key}
    return harness.call("POST", f"/api/v1{path}", json=body, headers=headers)


def ask(harness: Harness, job: str, tag: str, **query: Any) -> httpx.Response:
    headers = {"If-None-Match": tag}
    return harness.call("GET", f"/api/v1/jobs/{job}", params=query, headers=headers)


def test_the_same_key_and_request_create_one_job(harness: Harness) -> None:
    first = create(harness, "cell 4, part 17")
    assert first.status_code == 201
    assert "idempotency-replayed" not in first.headers
    again = create(harness, "cell 4, part 17")
    assert again.status_code == 200
    assert again.headers["idempotency-replayed"] == "true"
    assert again.json()["id"] == first.json()["id"]
    assert again.headers["location"] == first.headers["location"]
    assert len(harness.get("/jobs")["jobs"]) == 1


def test_a_key_cannot_be_used_for_another_request(harness: Harness) -> None:
    job = create(harness, "k").json()["id"]
    other = create(harness, "k", {**GRIP, "force_mN": 12.0})
    assert other.status_code == 422
    assert other.json()["type"].endswith("idempotency-key-reused")
    assert other.json()["job"] == job


def test_a_calibration_is_created_once_too(harness: Harness) -> None:
    body = {"calibration": "noise"}
    first = create(harness, "n", body, "/calibrations")
    again = create(harness, "n", {**body, "kind": "calibrate"}, "/jobs")
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json()["id"] == again.json()["id"]


@pytest.mark.parametrize("key", ["", "x" * 256, "tab\there"])
def test_a_key_of_wrong_length_or_unprintable_characters_is_refused(
    harness: Harness, key: str
) -> None:
    assert create(harness, key).status_code == 422
    assert harness.get("/jobs")["jobs"] == []


def test_the_etag_of_a_job_changes_when_the_job_changes(harness: Harness) -> None:
    job = harness.playing_to(IN_APPROACH)
    response = harness.call("GET", f"/api/v1/jobs/{job}")
    tag = response.headers["etag"]
    assert tag == f'W/"{job}-{response.json()["revision"]}"'
    harness.bus.play(IN_APPROACH + 5)
    live = harness.live
    harness.until(lambda: (now := live.status.progress) is not None and now.seq == IN_APPROACH + 4)
    unchanged = ask(harness, job, tag)
    assert (unchanged.status_code, unchanged.headers["etag"]) == (304, tag)
    assert ask(harness, job, tag, wait="change", timeout_s=0.01).status_code == 304
    harness.acted(job, "stop")
    changed = ask(harness, job, tag, wait="change", timeout_s=20)
    assert changed.status_code == 200
    assert changed.json()["revision"] > response.json()["revision"]


def test_a_long_poll_by_revision_answers_with_the_next_change(harness: Harness) -> None:
    taken = harness.post("/jobs", {"kind": "grip"}).json()
    harness.reach(taken["id"], "ready")
    ready = harness.get(f"/jobs/{taken['id']}", wait="change", since=taken["revision"])
    assert ready["state"] == "ready"
    as_it_is = harness.get(
        f"/jobs/{taken['id']}", wait="change", since=ready["revision"], timeout_s=0.01
    )
    assert as_it_is == ready

    async def poll() -> httpx.Response:
        transport = httpx.ASGITransport(harness.app)
        base = "http://localhost/api/v1"
        async with httpx.AsyncClient(transport=transport, base_url=base) as client:
            query = {"wait": "change", "since": ready["revision"], "timeout_s": 30}
            waiting = asyncio.create_task(client.get(f"/jobs/{taken['id']}", params=query))
            await client.post(f"/jobs/{taken['id']}/actions", json={"type": "stop"})
            return await waiting

    assert asyncio.run(poll()).json()["revision"] > ready["revision"]


def test_a_job_is_found_by_its_outcome_and_by_labels_in_any_alphabet(harness: Harness) -> None:
    job = str(harness.grip(labels={"sample": 'Größe 7 "µ"'})["id"])
    harness.ended(job)
    for query in ({"outcome": "gripped"}, {"text": "Größe 7"}, {"text": "µ"}):
        found = harness.get("/jobs", **query)["jobs"]
        assert [one["id"] for one in found] == [job], query
    assert harness.get("/jobs", outcome="lost")["jobs"] == []


def test_an_action_is_stored_with_its_requester_and_time(harness: Harness) -> None:
    job = harness.playing_to(IN_APPROACH)
    assert harness.act(job, "stop", headers={"X-Operator": "x" * 961}).status_code == 422
    harness.act(job, "stop", headers={"X-Operator": "Ada, cell 4"})
    (action,) = harness.ended(job)["actions"]
    assert (action["by"], action["seq"]) == ("Ada, cell 4", IN_APPROACH)
    assert action["requested_at"] <= action["applied_at"]
    events, applied = harness.told("action", job=job)[-2:]
    assert (events.body["by"], events.body["applied"]) == ("Ada, cell 4", False)
    assert (applied.body["seq"], applied.body["applied"]) == (IN_APPROACH, True)


def test_jobs_are_found_by_kind_state_and_label(harness: Harness) -> None:
    names: list[str] = []
    for number in range(3):
        body = {"kind": "grip", "labels": {"part": f"bead {number}"}}
        job = harness.post("/jobs", body).json()["id"]
        harness.reach(job, "ready")
        harness.acted(job, "stop")
        harness.freed(job)
        names.insert(0, job)

    def found(**query: Any) -> list[str]:
        return [job["id"] for job in harness.get("/jobs", **query)["jobs"]]

    assert found() == names
    assert found(state="stopped", kind="grip", rig="demo") == names
    assert found(state="failed") == found(kind="track") == []
    assert found(label="part=bead 1") == [names[1]]
    assert found(text="BEAD 1") == [names[1]]
    assert found(text="ead") == found(text="part") == names
    assert found(text=names[2][-6:]) == [names[2]]
    assert found(text="100%") == found(text="force_mN") == []
    assert found(outcome="gripped") == []
    middle = harness.get(f"/jobs/{names[1]}")["created_at"]
    assert found(created_from=middle) == names[:2]
    assert found(created_to=middle) == [names[2]]
    assert found(created_from="2001-01-01T00:00:00+01:00", text="bead 2") == [names[0]]
    for odd in ({"created_from": "2026-03-01T10:00:00"}, {"created_to": "soon"}, {"text": ""}):
        assert harness.call("GET", "/api/v1/jobs", params=odd).status_code == 422
    page = harness.get("/jobs", limit=2)
    assert page["next"] == names[1]
    assert found(limit=2, before=page["next"]) == [names[2]]
    assert harness.get("/jobs", limit=3)["next"] is None
    assert harness.call("GET", "/api/v1/jobs", params={"label": "part"}).status_code == 422
    assert harness.call("GET", "/api/v1/jobs", params={"before": "none"}).status_code == 404


def together(harness: Harness, *bodies: dict[str, Any], key: str) -> list[httpx.Response]:
    """Send requests with one key at once."""

    async def send() -> list[httpx.Response]:
        transport = httpx.ASGITransport(harness.app)
        async with httpx.AsyncClient(transport=transport, base_url=BASE) as client:
            headers = {"Idempotency-Key": key}
            requested = [client.post("/jobs", json=body, headers=headers) for body in bodies]
            return await asyncio.gather(*requested)

    return asyncio.run(send())


@pytest.mark.parametrize("queue", [False, True])
def test_a_repeated_key_is_recognized_while_its_first_request_is_planned(
    harness: Harness, queue: bool
) -> None:
    body = {**GRIP, "queue": queue}
    answers = together(harness, *[body] * 6, key="k")
    assert sorted(answer.status_code for answer in answers) == [200] * 5 + [201]
    assert len({answer.json()["id"] for answer in answers}) == 1
    assert len(harness.get("/jobs")["jobs"]) == 1


def test_a_key_of_a_refused_request_can_be_used_again(harness: Harness) -> None:
    answers = together(harness, {**GRIP, "force_mN": 99.0}, {"kind": "grip"}, key="k")
    assert sorted(answer.status_code for answer in answers) == [201, 422]


def test_the_number_of_requests_waiting_for_a_key_is_limited(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pincette_supervisor.jobs.job_manager.WAITING", 1)
    answers = together(harness, *[GRIP] * 5, key="k")
    assert [answer.status_code for answer in answers].count(201) == 1
    late = [answer.json() for answer in answers if answer.status_code == 503]
    assert len(late) == 3
    assert all("again in a moment with the same key" in problem["detail"] for problem in late)


def test_a_caller_that_has_disconnected_starts_no_job(harness: Harness) -> None:
    """The body arrives complete, and the connection is closed while the job is being planned."""

    async def send() -> None:
        sent = False

        async def receive() -> dict[str, Any]:
            nonlocal sent
            if sent:
                return {"type": "http.disconnect"}
            sent = True
            return {"type": "http.request", "body": json.dumps(GRIP).encode()}

        async def passed_over(_message: Any) -> None:
            return

        scope = {
            "type": "http",
            "http_version": "1.1",
            "method": "POST",
            "path": "/api/v1/jobs",
            "raw_path": b"/api/v1/jobs",
            "query_string": b"",
            "scheme": "http",
            "client": ("127.0.0.1", 5),
            "headers": [(b"content-type", b"application/json"), (b"host", b"localhost")],
        }
        await harness.app(scope, receive, passed_over)

    asyncio.run(send())
    assert harness.get("/jobs")["jobs"] == []
    (entry,) = harness.get("/audit")["entries"]
    assert entry["status"] == 408
    assert entry["detail"] == "grip: the client closed the connection, nothing was started"


def test_a_long_poll_without_a_known_revision_waits_for_the_next_change(harness: Harness) -> None:
    ready = harness.post("/jobs", {"kind": "grip"}).json()
    harness.reach(ready["id"], "ready")
    still = harness.get(f"/jobs/{ready['id']}", wait="change", timeout_s=0.3)
    assert still["state"] == "ready"

    async def poll() -> httpx.Response:
        transport = httpx.ASGITransport(harness.app)
        async with httpx.AsyncClient(
            transport=transport, base_url="http://localhost/api/v1"
        ) as client:
            response = client.get(
                f"/jobs/{ready['id']}", params={"wait": "change", "timeout_s": 20}
            )
            waiting = asyncio.create_task(response)
            await asyncio.sleep(0.2)
            assert not waiting.done()
            await client.post(f"/jobs/{ready['id']}/actions", json={"type": "stop"})
            return await waiting

    assert asyncio.run(poll()).json()["revision"] > still["revision"]


@pytest.mark.parametrize("shown", ["Éva Ørsted", "李雷", "%E6%9D%8E%E9%9B%B7", "100 % sure"])
def test_an_operator_is_named_in_any_alphabet(harness: Harness, shown: str) -> None:
    job = harness.playing_to(IN_APPROACH)
    headers = {b"x-operator": shown.encode()}
    assert harness.act(job, "stop", headers=headers).status_code == 202
    (action,) = harness.ended(job)["actions"]
    assert action["by"] == unquote(shown)


def test_a_label_may_use_any_alphabet_and_can_be_searched(harness: Harness) -> None:
    job = str(harness.grip(labels={"Größe": "7 µm", "零件": "甲"})["id"])
    for text in ("Größe=7 µm", "零件=甲"):
        assert [one["id"] for one in harness.get("/jobs", label=text)["jobs"]] == [job]
    for text in ('a"b=c', "a b=c", "none", "=c"):
        refused = harness.call("GET", "/api/v1/jobs", params={"label": text})
        assert refused.status_code == 422, text


def test_jobs_of_an_unknown_rig_are_not_found(harness: Harness) -> None:
    refused = harness.call("GET", "/api/v1/jobs", params={"rig": "other"})
    assert refused.status_code == 404
    assert "there are demo" in refused.json()["detail"]
    assert harness.get("/jobs", rig="demo")["jobs"] == []


def test_a_missing_file_of_a_job_is_reported_with_the_reason(harness: Harness) -> None:
    job = harness.post("/jobs", {"kind": "grip"}).json()["id"]
    harness.reach(job, "ready")
    harness.acted(job, "stop")
    harness.ended(job)
    missing = harness.call("GET", f"/api/v1/jobs/{job}/artifacts/grip.png").json()["detail"]
    assert missing == f"no artifact 'grip.png'; job {job} has no record"
    made = str(harness.grip()["id"])
    harness.ended(made)
    missing = harness.call("GET", f"/api/v1/jobs/{made}/artifacts/burst.parquet").json()["detail"]
    assert "samples.parquet" in missing
    assert "burst.parquet," not in missing
