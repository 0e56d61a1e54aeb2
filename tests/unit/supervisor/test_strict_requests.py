"""A request with any unknown content does nothing, and in particular does not move the arm."""

from typing import Any

import pytest

from .harness import Harness

GRIP = b'{"kind": "grip", "autostart": true}'
JSON = {"content-type": "application/json"}


def send(harness: Harness, path: str, body: bytes = GRIP, headers: Any = JSON) -> Any:
    return harness.call("POST", f"/api/v1{path}", content=body, headers=headers)


def nothing_moved(harness: Harness) -> None:
    assert harness.get("/jobs")["jobs"] == []
    assert harness.bus.ticks == []


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("dryrun=true", "dryrun is not a known parameter; did you mean dry_run?"),
        ("dry-run=true", "did you mean dry_run?"),
        ("DRY_RUN=true", "did you mean dry_run?"),
        ("dry_run=true&dry_run=false", "dry_run is given 2 times: send it once"),
        ("x=1", "x is not a known parameter"),
    ],
)
def test_a_typing_error_does_not_turn_a_dry_run_into_motion(
    harness: Harness, query: str, words: str
) -> None:
    answer = send(harness, f"/jobs?{query}")
    assert answer.status_code == 422
    problem = answer.json()
    assert problem["type"] == "urn:pincette:problem:invalid-request"
    assert problem["errors"][0]["parameter"] == query.partition("=")[0]
    assert words in problem["errors"][0]["message"]
    nothing_moved(harness)


def test_only_the_name_dry_run_is_accepted_in_the_body_of_a_request(harness: Harness) -> None:
    answer = harness.post("/jobs", {"kind": "grip", "autostart": True, "dryRun": True})
    assert answer.status_code == 422
    assert "did you mean dry_run?" in answer.json()["errors"][0]["message"]
    assert harness.post("/jobs", {"kind": "grip", "dry_run": True}).status_code == 200
    nothing_moved(harness)


@pytest.mark.parametrize(
    "path",
    [
        "/api/v1/jobs",
        "/api/v1/rigs",
        "/api/v1/rigs/demo",
        "/api/v1/events",
        "/livez",
        "/metrics",
        "/",
    ],
)
def test_every_route_refuses_what_it_does_not_know(harness: Harness, path: str) -> None:
    answer = harness.call("GET", path, params={"rgi": "x"})
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["parameter"] == "rgi"


def test_an_emergency_stop_ignores_every_parameter(harness: Harness) -> None:
    for path in ("/estop?now=1&now=2", "/rigs/demo/estop?x"):
        assert send(harness, path, b"<stop/>", {"content-type": "text/xml"}).status_code == 200


@pytest.mark.parametrize("kind", ["text/plain", "application/x-www-form-urlencoded", ""])
def test_a_body_of_another_type_is_refused(harness: Harness, kind: str) -> None:
    answer = send(harness, "/jobs", headers={"content-type": kind} if kind else {})
    assert answer.status_code == 415
    assert "send Content-Type: application/json" in answer.json()["detail"]
    nothing_moved(harness)


@pytest.mark.parametrize("kind", ["application/json; charset=utf-8", "application/vnd.x+json"])
def test_variants_of_the_json_content_type_are_accepted(harness: Harness, kind: str) -> None:
    path = "/jobs?dry_run=true&predict=false"
    assert send(harness, path, headers={"content-type": kind}).status_code == 200


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b'{"kind": "grip", "dry_run": true, "dry_run": false}', "'dry_run' is given 2 times"),
        (b'{"kind": "grip", "labels": {"a": "b", "a": "c"}}', "'a' is given 2 times"),
        (b'{"kind": ', "line 1, column 10"),
        (b"[" * 5_000, "nested too deeply"),
        (b'{"kind": "\xff"}', "byte 10 is not UTF-8"),
    ],
)
def test_invalid_json_is_refused_with_the_position_of_the_error(
    harness: Harness, body: bytes, words: str
) -> None:
    answer = send(harness, "/jobs", body)
    assert answer.status_code == 400
    assert answer.json()["type"] == "urn:pincette:problem:bad-json"
    assert words in answer.json()["detail"]
    nothing_moved(harness)
