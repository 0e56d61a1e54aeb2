"""Requests that cannot be used get an answer that says what, the value, the unit, the limit."""

from typing import Any

import pytest

from .rig import Desk

MEDIA_TYPE = "application/problem+json"


def refused(desk: Desk, body: dict[str, Any]) -> dict[str, Any]:
    response = desk.post("/jobs", body)
    assert response.status_code == 422
    assert response.headers["content-type"] == MEDIA_TYPE
    assert desk.get("/jobs")["jobs"] == []
    return response.json()


@pytest.mark.parametrize(
    ("wish", "pointer", "words"),
    [
        ({"force_mN": "20"}, "/force_mN", "force_mN = '20' mN"),
        ({"force_mN": True}, "/force_mN", "force_mN = True mN"),
        ({"force_mN": -3.0}, "/force_mN", "force_mN = -3.0 mN: input should be greater than 0 mN"),
        ({"hold_s": 1e9}, "/hold_s", "less than or equal to 3600 s"),
        ({"seek_um_per_s": 0.0}, "/seek_um_per_s", "greater than or equal to 0.1 µm/s"),
        ({"force_N": 1.0}, "/force_N", "force_N is not a field that is known here"),
        ({"autostart": "yes"}, "/autostart", "autostart = 'yes'"),
        ({"labels": {"a": 1}}, "/labels/a", "a = 1"),
        ({"kind": "weld"}, "/kind", "kind = 'weld'"),
        ({"hold_s": 1.0, "until_released": True}, "", "exclude each other"),
    ],
)
def test_a_fault_is_named_with_its_place_and_value(
    desk: Desk, wish: dict[str, Any], pointer: str, words: str
) -> None:
    problem = refused(desk, {"kind": "grip", **wish})
    assert problem["type"] == "urn:pincette:problem:invalid-request"
    (error,) = problem["errors"]
    assert error["pointer"] == pointer
    assert words in error["message"]


def test_a_missing_kind_is_named(desk: Desk) -> None:
    (error,) = refused(desk, {"force_mN": 10.0})["errors"]
    assert error == {"pointer": "/kind", "message": "kind is missing"}


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_what_is_not_finite_is_refused(desk: Desk, number: str) -> None:
    response = desk.call(
        "POST",
        "/api/v1/jobs",
        content=f'{{"kind": "grip", "force_mN": {number}}}',
        headers={"content-type": "application/json"},
    )
    assert response.status_code == 422
    assert "finite number" in response.json()["errors"][0]["message"]


def test_what_is_not_json_is_refused(desk: Desk) -> None:
    headers = {"content-type": "application/json"}
    response = desk.call("POST", "/api/v1/jobs", content=b'{"kind": ', headers=headers)
    assert response.status_code == 422
    assert "not JSON" in response.json()["detail"]


def test_a_force_beyond_the_limit_names_value_limit_unit_and_time(desk: Desk) -> None:
    problem = refused(desk, {"kind": "grip", "force_mN": 55.0})
    assert problem["type"] == "urn:pincette:problem:limit-violation"
    violations = [v for v in problem["violations"] if v["quantity"] == "force"]
    assert violations
    assert violations[0]["pointer"] == "/force_mN"
    assert (violations[0]["limit"], violations[0]["unit"]) == (40.0, "mN")
    assert violations[0]["value"] > 40.0
    assert violations[0]["at_s"] > 0.0
    assert "40" in violations[0]["message"]


def test_a_dry_run_answers_with_the_plan_and_makes_no_job(desk: Desk) -> None:
    response = desk.post("/jobs", {"kind": "grip"}, dry_run="true")
    assert response.status_code == 200
    plan = response.json()
    assert plan["feasible"] is True
    assert plan["violations"] == []
    assert [phase["phase"] for phase in plan["phases"]][-2:] == ["unload", "retreat"]
    assert max(plan["curves"]["force_r_mN"]) == pytest.approx(20.0)
    assert len(plan["curves"]["t_s"]) <= 402
    assert desk.get("/jobs")["jobs"] == []


def test_a_dry_run_shows_an_infeasible_plan(desk: Desk) -> None:
    response = desk.post("/jobs", {"kind": "grip", "force_mN": 55.0, "dry_run": True})
    assert response.status_code == 200
    assert response.json()["feasible"] is False
    assert response.json()["violations"]


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", "/api/v1/jobs/none", 404, "not-found"),
        ("GET", "/api/v1/rigs/none", 404, "not-found"),
        ("POST", "/api/v1/rigs/none/estop", 404, "not-found"),
        ("GET", "/nowhere", 404, "not-found"),
        ("DELETE", "/api/v1/jobs", 405, "method-not-allowed"),
        ("GET", "/docs", 404, "not-found"),
        ("GET", "/api/v1/jobs?limit=0", 422, "invalid-request"),
        ("GET", "/api/v1/jobs/none?wait=terminal&timeout_s=61", 422, "invalid-request"),
    ],
)
def test_every_error_is_a_problem_document(
    desk: Desk, method: str, path: str, status: int, code: str
) -> None:
    response = desk.call(method, path)
    assert response.status_code == status
    assert response.headers["content-type"] == MEDIA_TYPE
    problem = response.json()
    assert problem["type"] == f"urn:pincette:problem:{code}"
    assert problem["status"] == status
    assert problem["detail"]


def test_a_rig_that_is_not_here_is_named_with_those_that_are(desk: Desk) -> None:
    response = desk.post("/jobs", {"kind": "grip", "rig": "other"})
    assert response.status_code == 404
    assert "'other'" in response.json()["detail"]
    assert "demo" in response.json()["detail"]
