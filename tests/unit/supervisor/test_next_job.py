"""A job that has ended does not block the next; hold and release need a held part."""

from threading import Timer
from typing import Any

import pytest

from .canned import IN_HOLD
from .harness import Harness


@pytest.mark.parametrize("kind", ["release", "hold"])
def test_jobs_that_need_a_part_are_refused_without_one(harness: Harness, kind: str) -> None:
    harness.ended(harness.grip()["id"])
    view = harness.get("/rigs/demo")
    assert view["part"] == "none"
    assert kind not in view["startable"]
    assert "grip" in view["startable"]
    refused = harness.post("/jobs", {"kind": kind})
    assert refused.status_code == 409, refused.text
    problem: dict[str, Any] = refused.json()
    assert problem["type"] == "urn:pincette:problem:nothing-held"
    assert "holds no part" in problem["detail"]
    assert problem["remedy"].startswith("grip a part first")


def test_a_wait_for_the_end_lasts_until_a_release_has_freed_the_part(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.acted(job, "stop")
    assert harness.get(f"/jobs/{job}", wait="terminal", timeout_s=5.0)["state"] == "stopped"
    manager = harness.manager
    assert manager.index.is_over(job)
    live = manager.active
    assert live is not None
    assert (live.status.terminal, live.status.over) == (True, False)
    live.update(letting_go=True)
    assert not manager.index.is_over(job)


def test_an_ended_job_does_not_occupy_the_rig(harness: Harness) -> None:
    job = harness.playing_to(IN_HOLD)
    harness.acted(job, "stop")
    harness.ended(job)
    live = harness.live
    assert harness.get("/rigs/demo")["active_job"] == job
    live.update(held=False)  # its program is over, and its result is being worked out
    view = harness.get("/rigs/demo")
    assert view["active_job"] is None
    # A request that comes now waits for it.
    Timer(0.2, live.finish).start()
    refused = harness.post("/jobs", {"kind": "grip"})
    assert refused.json().get("type", "") != "urn:pincette:problem:job-active", refused.text


@pytest.mark.parametrize(
    ("body", "named", "hint"),
    [
        ({"kind": "grip", "force": 9.0}, "force", "did you mean force_mN?"),
        ({"kind": "grip", "Force_mN": 9.0}, "Force_mN", "did you mean force_mN?"),
        ({"kind": "grip", "force_N": 9.0}, "force_N", "did you mean force_mN?"),
        ({"kind": "grip", "hold": 9.0}, "hold", "did you mean hold_s?"),
        ({"kind": "release", "release": 1.0}, "release", "did you mean release_s?"),
        ({"kind": "release", "force_mN": 1.0}, "force_mN", ""),
        ({"kind": "move", "force_mN": 1.0}, "force_mN", ""),
    ],
)
def test_the_hint_for_an_unknown_field_names_a_field_of_the_same_kind(
    harness: Harness, body: dict[str, Any], named: str, hint: str
) -> None:
    (error,) = harness.post("/jobs", body).json()["errors"]
    assert error["pointer"] == f"/{named}"
    assert error["message"].startswith(f"{named} is not a known field")
    assert hint in error["message"]
    if not hint:
        assert f"did you mean {named}?" not in error["message"]
