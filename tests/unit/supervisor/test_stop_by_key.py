"""A request is stopped by its Idempotency-Key, whether or not it has its job yet."""

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

from pincette_supervisor.jobs.job_manager import JobManager

from .harness import Harness

GRIP = {"kind": "grip", "autostart": True}
IN_APPROACH = 40


def create(harness: Harness, key: str) -> httpx.Response:
    return harness.call("POST", "/api/v1/jobs", json=GRIP, headers={"Idempotency-Key": key})


def stop(harness: Harness, key: str) -> Any:
    response = harness.post("/jobs/stop", {"idempotency_key": key})
    assert response.status_code == 200, response.text
    return response.json()["job"]


def test_a_request_stopped_while_being_planned_creates_no_job(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    planning, go_on, resolve = threading.Event(), threading.Event(), JobManager.resolve

    def slowly(manager: JobManager, request: Any) -> Any:
        planning.set()
        assert go_on.wait(20.0)
        return resolve(manager, request)

    monkeypatch.setattr(JobManager, "resolve", slowly)
    with ThreadPoolExecutor(1) as pool:
        requested = pool.submit(create, harness, "execution 7")
        assert planning.wait(20.0)
        assert stop(harness, "execution 7") is None
        go_on.set()
        answer = requested.result(20.0)
    assert answer.status_code == 409
    problem = answer.json()
    assert problem["type"].endswith("key-stopped")
    assert problem["remedy"] == "use a new key for another request"
    assert harness.get("/jobs")["jobs"] == []
    assert harness.bus.epoch == 0, "the rig was armed"


def test_a_request_that_arrives_after_its_stop_creates_no_job(harness: Harness) -> None:
    assert stop(harness, "early") is None
    assert create(harness, "early").status_code == 409
    assert create(harness, "another").status_code == 201


def test_the_job_of_a_key_is_stopped_once(harness: Harness) -> None:
    harness.bus.pause_at = IN_APPROACH
    job = create(harness, "k").json()["id"]
    harness.reach(job, "running")
    stopped = stop(harness, "k")
    assert (stopped["id"], stopped["actions"][0]["type"]) == (job, "stop")
    assert harness.ended(job)["state"] == "stopped"
    assert stop(harness, "k")["state"] == "stopped"
    replayed = create(harness, "k")
    assert (replayed.status_code, replayed.json()["id"]) == (200, job)


def test_an_ended_job_is_not_changed(harness: Harness) -> None:
    job = create(harness, "k").json()["id"]
    assert harness.ended(job)["state"] == "succeeded"
    assert stop(harness, "k")["state"] == "succeeded"


@pytest.mark.parametrize("key", ["", "x" * 256, "tab\there"])
def test_an_invalid_key_is_refused(harness: Harness, key: str) -> None:
    assert harness.post("/jobs/stop", {"idempotency_key": key}).status_code == 422
