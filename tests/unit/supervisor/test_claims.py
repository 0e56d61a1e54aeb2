"""A claim on a rig: clients that it blocks and does not block, its end, and its visibility."""

from typing import Any

import httpx
import pytest

from pincette_supervisor.jobs.job_queue import Claims
from pincette_supervisor.journal.events import EventLog

from .harness import Harness

MINE, YOURS = "my-secret-of-a-claim", "your-secret-of-a-claim"
CLAIM = "/rigs/demo/claim"


def claim(harness: Harness, token: str = MINE, lease_s: float = 60.0) -> httpx.Response:
    headers = {"X-Claim": token, "X-Operator": token.partition("-")[0]}
    return harness.call("PUT", f"/api/v1{CLAIM}", json={"lease_s": lease_s}, headers=headers)


def drop(harness: Harness, token: str | None = None, **query: Any) -> httpx.Response:
    headers = {} if token is None else {"X-Claim": token}
    return harness.call("DELETE", f"/api/v1{CLAIM}", headers=headers, params=query)


def grip(harness: Harness, token: str | None = None, **more: Any) -> httpx.Response:
    headers = {} if token is None else {"X-Claim": token}
    body = {"kind": "grip", "autostart": True, **more}
    return harness.call("POST", "/api/v1/jobs", json=body, headers=headers)


def test_all_clients_see_the_owner_of_a_claim(harness: Harness) -> None:
    taken = claim(harness)
    assert taken.status_code == 200, taken.text
    seen = harness.get("/rigs/demo")["claim"]
    assert (seen["by"], seen["since"]) == ("my", taken.json()["since"])
    assert 0.0 < seen["left_s"] <= 60.0
    assert MINE not in str(harness.get("/rigs/demo"))
    assert [event.body["change"] for event in harness.told("claim")] == ["taken"]


def test_other_clients_cannot_start_jobs_and_the_refusal_names_the_holder(harness: Harness) -> None:
    claim(harness)
    for refused in (
        grip(harness),
        grip(harness, YOURS),
        claim(harness, YOURS),
        harness.post("/rigs/demo/reset", {"acknowledge": True}),
        harness.post("/rigs/demo/queue/actions", {"type": "resume"}),
        harness.post("/rigs/demo/model/actions", {"type": "use", "version": 0}),
        drop(harness),
    ):
        assert refused.status_code == 409, refused.text
        assert refused.json()["type"].endswith("rig-claimed")
        assert refused.json()["claim"]["by"] == "my"
    assert harness.get("/jobs")["jobs"] == []


def test_requests_that_move_nothing_are_permitted_to_all_clients_during_a_claim(
    harness: Harness,
) -> None:
    claim(harness)
    assert grip(harness, dry_run=True).status_code == 200
    assert harness.post("/rigs/demo/queue/actions", {"type": "clear"}).status_code == 200


def test_the_holder_can_start_jobs(harness: Harness) -> None:
    claim(harness)
    taken = grip(harness, MINE)
    assert taken.status_code == 201, taken.text
    assert harness.ended(taken.json()["id"])["state"] == "succeeded"


@pytest.mark.parametrize("action", ["stop", "abort"])
def test_every_user_may_stop(harness: Harness, action: str) -> None:
    harness.bus.pause_at = 100
    job = grip(harness).json()["id"]
    harness.reach(job, "running")
    claim(harness)
    refused = harness.act(job, "pause")
    assert refused.status_code == 409
    assert refused.json()["type"].endswith("rig-claimed")
    assert harness.act(job, action).status_code == 202


def test_every_client_may_send_an_emergency_stop(harness: Harness) -> None:
    claim(harness)
    assert harness.post("/rigs/demo/estop").status_code == 200
    assert len(harness.bus.trips) == 1


def test_a_claim_can_be_renewed_returned_and_taken_away(harness: Harness) -> None:
    since = claim(harness, lease_s=10.0).json()["since"]
    renewed = claim(harness, lease_s=100.0).json()
    assert renewed["since"] == since
    assert renewed["left_s"] > 90.0
    assert drop(harness, MINE).json()["claim"] is None
    assert drop(harness).status_code == 200  # there is none: nothing is to be done
    claim(harness, YOURS)
    assert drop(harness, MINE, force=True).json()["claim"] is None
    assert [event.body["change"] for event in harness.told("claim")] == [
        "taken",
        "returned",
        "taken",
        "broken",
    ]
    assert harness.told("claim")[-1].body["holder"] == "your"
    assert grip(harness).status_code == 201


def test_a_repeated_request_returns_its_job_even_if_another_client_has_claimed_the_rig(
    harness: Harness,
) -> None:
    headers = {"Idempotency-Key": "once"}
    body = {"kind": "grip", "autostart": True}
    first = harness.call("POST", "/api/v1/jobs", json=body, headers=headers)
    claim(harness)
    again = harness.call("POST", "/api/v1/jobs", json=body, headers=headers)
    assert again.status_code == 200
    assert again.json()["id"] == first.json()["id"]


def test_a_claim_expires_and_survives_a_restart(harness: Harness) -> None:
    now_s = 1000.0

    def clock() -> float:
        return now_s

    events = EventLog(harness.store, "demo")
    claims = Claims(harness.store, events, harness.manager.context.write_queue, clock)
    claims.take(MINE, by="me", note="night run", lease_s=30.0)
    now_s += 10.0
    later = Claims(
        harness.store, events, harness.manager.context.write_queue, clock
    )  # the wall clock says when it ends
    found = later.current()
    assert found is not None
    assert (found.by, found.note) == ("me", "night run")
    later.require(MINE)
    now_s += 30.0
    assert later.current() is None
    later.require(YOURS)
    later.take(YOURS, by="you", note="", lease_s=1.0)


@pytest.mark.parametrize(("token", "lease_s"), [("short", 60.0), (MINE, 0.5), (MINE, 4000.0)])
def test_an_invalid_claim_is_refused(harness: Harness, token: str, lease_s: float) -> None:
    assert claim(harness, token, lease_s).status_code == 422
