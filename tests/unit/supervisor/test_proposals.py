"""A job that a person must approve before it can begin."""

from collections.abc import Callable
from typing import Any

import httpx
import pytest

from pincette.config import RigFile
from pincette_supervisor.jobs.job_queue import CAPACITY
from pincette_supervisor.journal.store import utc_now
from tests.support.keys import ScopeKeys

from .harness import Harness

GRIP = {"kind": "grip", "autostart": True, "hold_s": 0.5}
PROBLEM = "urn:pincette:problem:"
PROPOSED = {**GRIP, "approval_s": 600.0}


def proposed(harness: Harness, **wishes: Any) -> str:
    response = harness.post("/jobs", {**PROPOSED, **wishes})
    assert response.status_code == 201, response.text
    job = response.json()
    assert job["state"] == "proposed"
    return job["id"]


def act(harness: Harness, job: str, action: str, **details: Any) -> httpx.Response:
    path = f"/api/v1/jobs/{job}/actions"
    return harness.call("POST", path, json={"type": action}, **details)


def test_a_proposed_job_waits_without_the_rig_and_runs_once_approved(harness: Harness) -> None:
    job = proposed(harness)
    view = harness.get(f"/jobs/{job}")
    assert view["approval_until"] > view["created_at"]
    assert view["allowed_actions"] == ["approve", "reject", "stop", "abort"]
    rig = harness.get("/rigs/demo")
    assert (rig["active_job"], rig["queue"]["proposed"], rig["queue"]["length"]) == (None, 1, 0)
    assert act(harness, job, "approve").status_code == 202
    ended = harness.ended(job)
    assert (ended["state"], ended["approval_until"]) == ("succeeded", None)
    assert [one["type"] for one in ended["actions"]] == ["approve"]
    assert harness.get("/rigs/demo")["queue"]["proposed"] == 0
    states = [event.body["state"] for event in harness.told("state", job=job)]
    assert states[:3] == ["proposed", "queued", "preparing"]


def test_a_job_that_waits_for_its_end_ends_once(harness: Harness) -> None:
    job = proposed(harness)
    assert harness.get(f"/jobs/{job}", wait="terminal", timeout_s=0.05)["state"] == "proposed"
    revision = harness.get(f"/jobs/{job}")["revision"]
    assert act(harness, job, "reject").status_code == 202
    found = harness.get(f"/jobs/{job}", wait="change", since=revision, timeout_s=30)
    assert (found["state"], found["ending"]["code"]) == ("stopped", "rejected")
    assert act(harness, job, "approve").status_code == 409


@pytest.mark.parametrize(("action", "state"), [("stop", "stopped"), ("abort", "aborted")])
def test_a_stop_or_an_abort_withdraws_a_proposal(harness: Harness, action: str, state: str) -> None:
    job = proposed(harness)
    assert act(harness, job, action).status_code == 202
    ended = harness.ended(job)
    assert (ended["state"], ended["ending"]["code"]) == (state, "requested")
    assert harness.bus.trips == []


def test_an_action_that_a_proposed_job_does_not_allow_is_refused(harness: Harness) -> None:
    job = proposed(harness)
    assert act(harness, job, "start").status_code == 409
    assert harness.get(f"/jobs/{job}")["actions"] == []


def test_an_approved_job_is_refused_while_another_has_the_rig_and_stays_proposed(
    harness: Harness,
) -> None:
    first, queueing = proposed(harness), proposed(harness, queue=True)
    running = harness.playing_to(100)
    refused = act(harness, first, "approve")
    assert (refused.status_code, refused.json()["type"]) == (409, f"{PROBLEM}job-active")
    assert harness.get(f"/jobs/{first}")["state"] == "proposed"
    assert act(harness, queueing, "approve").status_code == 202
    view = harness.get(f"/jobs/{queueing}")
    assert (view["state"], view["position"]) == ("queued", 1)
    assert harness.get(f"/jobs/{running}")["state"] == "running"


def test_a_latched_rig_refuses_an_approval(harness: Harness) -> None:
    job = proposed(harness)
    harness.post("/rigs/demo/estop")
    assert act(harness, job, "approve").json()["type"] == f"{PROBLEM}estop-engaged"
    assert harness.get(f"/jobs/{job}")["state"] == "proposed"


def test_a_claim_of_another_client_blocks_the_approval_and_not_the_rejection(
    harness: Harness,
) -> None:
    first, second = proposed(harness), proposed(harness)
    token = {"X-Claim": 20 * "a"}
    path = "/api/v1/rigs/demo/claim"
    assert harness.call("PUT", path, json={"lease_s": 60}, headers=token).status_code == 200
    assert act(harness, first, "approve").json()["type"] == f"{PROBLEM}rig-claimed"
    assert act(harness, second, "reject").status_code == 202


def test_a_proposal_expires(harness: Harness) -> None:
    job, other = proposed(harness, approval_s=1e-3), proposed(harness)
    harness.manager.expire()
    ended = harness.ended(job)
    assert (ended["state"], ended["ending"]["code"]) == ("stopped", "proposal_expired")
    assert harness.get(f"/jobs/{other}")["state"] == "proposed"


def test_a_late_approval_starts_nothing(harness: Harness) -> None:
    job = proposed(harness, approval_s=1e-3)
    assert act(harness, job, "approve").status_code == 409
    assert harness.ended(job)["ending"]["code"] == "proposal_expired"


def test_proposals_survive_a_restart(
    harness: Harness, rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    kept, late = proposed(harness), proposed(harness, approval_s=1e-3)
    harness.manager.close()
    after = open_harness(rig_file)
    assert after.store.interrupt_unfinished(utc_now()) == []
    after.manager.recover([])
    after.manager.expire()
    assert after.get(f"/jobs/{late}")["ending"]["code"] == "proposal_expired"
    assert act(after, kept, "approve").status_code == 202
    assert after.ended(kept)["state"] == "succeeded"


def test_a_key_creates_one_proposal_and_the_number_of_proposals_is_limited(
    harness: Harness,
) -> None:
    key = {"Idempotency-Key": "one"}
    jobs = [
        harness.call("POST", "/api/v1/jobs", json=PROPOSED, headers=key).json()["id"]
        for _ in range(2)
    ]
    assert jobs[0] == jobs[1]
    for _ in range(CAPACITY - 1):
        proposed(harness)
    assert harness.post("/jobs", PROPOSED).json()["type"] == f"{PROBLEM}proposals-full"


def test_a_job_that_breaks_a_limit_cannot_be_proposed(harness: Harness) -> None:
    assert (
        harness.post("/jobs", {**PROPOSED, "force_mN": 1e4}).json()["type"]
        == f"{PROBLEM}limit-violation"
    )


def test_a_series_of_proposed_jobs_is_refused(harness: Harness) -> None:
    body = {"job": PROPOSED, "repeats": 2}
    assert harness.post("/rigs/demo/series", body).status_code in (404, 405, 422)
    assert harness.post("/series", body).status_code == 422


def test_the_scope_propose_permits_plans_and_proposals_but_no_start(
    harness: Harness, ring: ScopeKeys
) -> None:
    agent = ring.headers("propose")

    def post(body: Any, path: str = "/api/v1/jobs") -> httpx.Response:
        return harness.call("POST", path, json=body, headers=agent)

    assert post({**GRIP, "dry_run": True}).status_code == 200
    refused = post(GRIP)
    assert (refused.status_code, refused.json()["needed_scope"]) == (403, "operate")
    seen = ring.headers("observe")
    needed = {
        scope: harness.call("POST", "/api/v1/jobs", json=body, headers=seen).json()["needed_scope"]
        for scope, body in (("operate", GRIP), ("propose", PROPOSED))
    }
    assert needed == {"operate": "operate", "propose": "propose"}
    assert (
        harness.call(
            "POST", "/api/v1/jobs", json=PROPOSED, headers=ring.headers("observe")
        ).status_code
        == 403
    )
    job = post(PROPOSED).json()["id"]
    for action in ("approve", "reject", "start", "stop", "abort"):
        assert act(harness, job, action, headers=agent).status_code == 403
    for path, body in (
        ("/api/v1/series", {"job": GRIP}),
        ("/api/v1/calibrations", {"calibration": "noise"}),
        ("/api/v1/rigs/demo/reset", {"acknowledge": True}),
        ("/api/v1/rigs/demo/queue/actions", {"type": "clear"}),
        ("/api/v1/jobs/stop", {"idempotency_key": "one"}),
    ):
        assert post(body, path).status_code == 403, path
    assert harness.manager.active is None
    assert act(harness, job, "approve", headers=ring.headers("operate")).status_code == 202
    harness.until(lambda: harness.manager.index.is_over(job))
    assert post({}, "/api/v1/rigs/demo/estop").status_code == 200


def test_the_audit_log_has_the_names_of_the_proposing_and_the_approving_client(
    harness: Harness, ring: ScopeKeys
) -> None:
    agent, person = ring.headers("propose"), ring.headers("operate")
    job = harness.call("POST", "/api/v1/jobs", json=PROPOSED, headers=agent).json()
    assert job["by"] == "an-propose"
    act(harness, job["id"], "approve", headers=person)
    assert harness.manager.index.job(job["id"]).actions[0].by == "an-operate"
    rows = harness.app.state.access.audit_buffer._waiting
    told = [(row.who, row.detail) for row in rows]
    assert ("an-propose", f"propose grip {job['id']}") in told
    assert ("an-operate", "approve, proposed by an-propose") in told
    harness.until(lambda: harness.manager.index.is_over(job["id"]))
