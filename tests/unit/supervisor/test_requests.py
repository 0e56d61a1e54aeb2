"""Invalid requests are refused with the reason, the value, the unit and the limit."""

from typing import Any

import pytest

from .harness import Harness

MEDIA_TYPE = "application/problem+json"
K_E, CONTACT_UM = 2.17, 30.0
"""Stiffness in mN/µm and position of the demo rig's part."""
POSITIONS = [{"t_s": 0.0, "x_um": CONTACT_UM + 4.0}, {"t_s": 2.0, "x_um": CONTACT_UM + 5.0}]
FORCES = [{"t_s": 0.0, "force_mN": K_E * 4.0}, {"t_s": 2.0, "force_mN": K_E * 5.0}]


def refused(harness: Harness, body: dict[str, Any]) -> dict[str, Any]:
    response = harness.post("/jobs", body)
    assert response.status_code == 422
    assert response.headers["content-type"] == MEDIA_TYPE
    assert harness.get("/jobs")["jobs"] == []
    return response.json()


@pytest.mark.parametrize(
    ("wish", "pointer", "words"),
    [
        ({"force_mN": "20"}, "/force_mN", "force_mN = '20' mN"),
        ({"force_mN": True}, "/force_mN", "force_mN = true mN"),
        ({"on_stop": False}, "/on_stop", "on_stop = false: must be"),
        ({"place": [None]}, "/place", "place = a list: must be an object"),
        ({"kind": True}, "/kind", "kind = true"),
        ({"kind": None}, "/kind", "kind = null"),
        ({"force_mN": -3.0}, "/force_mN", "force_mN = -3.0 mN: must be above 0 mN"),
        ({"hold_s": 1e9}, "/hold_s", "must be 3600 s or less"),
        ({"seek_um_per_s": 0.0}, "/seek_um_per_s", "must be 0.1 µm/s or more"),
        ({"force_N": 1.0}, "/force_N", "force_N is not a known field"),
        ({"autostart": "yes"}, "/autostart", "autostart = 'yes'"),
        ({"labels": {"a": 1}}, "/labels/a", "a = 1"),
        ({"kind": "weld"}, "/kind", "kind = 'weld'"),
        ({"hold_s": 1.0, "until_released": True}, "", "exclude each other"),
    ],
)
def test_an_invalid_field_is_reported_with_its_location_and_value(
    harness: Harness, wish: dict[str, Any], pointer: str, words: str
) -> None:
    problem = refused(harness, {"kind": "grip", **wish})
    assert problem["type"] == "urn:pincette:problem:invalid-request"
    (error,) = problem["errors"]
    assert error["pointer"] == pointer
    assert words in error["message"]


def test_a_missing_kind_is_named(harness: Harness) -> None:
    (error,) = refused(harness, {"force_mN": 10.0})["errors"]
    assert error == {"pointer": "/kind", "message": "kind is missing"}


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity"])
def test_non_finite_numbers_are_refused(harness: Harness, number: str) -> None:
    response = harness.call(
        "POST",
        "/api/v1/jobs",
        content=f'{{"kind": "grip", "force_mN": {number}}}',
        headers={"content-type": "application/json"},
    )
    assert response.status_code == 422
    assert "finite number" in response.json()["errors"][0]["message"]


def test_a_force_beyond_the_limit_names_value_limit_unit_and_time(harness: Harness) -> None:
    problem = refused(harness, {"kind": "grip", "force_mN": 55.0})
    assert problem["type"] == "urn:pincette:problem:limit-violation"
    violations = [v for v in problem["violations"] if v["quantity"] == "force"]
    assert violations
    assert violations[0]["pointer"] == "/force_mN"
    assert (violations[0]["limit"], violations[0]["unit"]) == (40.0, "mN")
    assert violations[0]["value"] > 40.0
    assert {violation["side"] for violation in violations} == {"above"}
    assert violations[0]["at_s"] > 0.0
    assert "40" in violations[0]["message"]


def test_a_dry_run_returns_the_plan_and_creates_no_job(harness: Harness) -> None:
    response = harness.post("/jobs", {"kind": "grip"}, dry_run="true")
    assert response.status_code == 200
    plan = response.json()
    assert plan["feasible"] is True
    assert plan["violations"] == []
    assert [phase["phase"] for phase in plan["phases"]][-2:] == ["unload", "retreat"]
    assert max(plan["curves"]["force_r_mN"]) == pytest.approx(20.0)
    assert len(plan["curves"]["t_s"]) <= 402
    assert harness.get("/jobs")["jobs"] == []


def test_a_dry_run_shows_an_infeasible_plan(harness: Harness) -> None:
    response = harness.post("/jobs", {"kind": "grip", "force_mN": 55.0, "dry_run": True})
    assert response.status_code == 200
    assert response.json()["feasible"] is False
    assert response.json()["violations"]


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", "/api/v1/jobs/none", 404, "not-found"),
        ("GET", "/api/v1/rigs/none", 404, "not-found"),
        ("GET", "/api/v1/rigs/demo/history?job=none", 404, "not-found"),
        ("POST", "/api/v1/rigs/none/estop", 404, "not-found"),
        ("GET", "/nowhere", 404, "not-found"),
        ("DELETE", "/api/v1/jobs", 405, "method-not-allowed"),
        ("GET", "/docs", 404, "not-found"),
        ("GET", "/api/v1/jobs?limit=0", 422, "invalid-request"),
        ("GET", "/api/v1/jobs/none?wait=terminal&timeout_s=61", 422, "invalid-request"),
    ],
)
def test_every_error_is_a_problem_document(
    harness: Harness, method: str, path: str, status: int, code: str
) -> None:
    response = harness.call(method, path)
    assert response.status_code == status
    assert response.headers["content-type"] == MEDIA_TYPE
    problem = response.json()
    assert problem["type"] == f"urn:pincette:problem:{code}"
    assert problem["status"] == status
    assert problem["detail"]


def test_an_unknown_rig_is_named_with_the_existing_rigs(harness: Harness) -> None:
    response = harness.post("/jobs", {"kind": "grip", "rig": "other"})
    assert response.status_code == 404
    assert "'other'" in response.json()["detail"]
    assert "demo" in response.json()["detail"]


@pytest.mark.parametrize(
    ("wish", "pointer", "words"),
    [
        ({"cycles": 0}, "/cycles", "cycles = 0: must be 1 or more"),
        ({"cycles": 2.5}, "/cycles", "cycles = 2.5"),
        ({"force_N": 20.0}, "/force_N", "force_N is not a known field"),
        ({"force_mN": 20.0}, "/force_mN", "force_mN is for 2 driven arms, and this rig has 1"),
        ({"shape": "square"}, "/shape", "shape = 'square'"),
        ({"force_pp_mN": 20.0, "x_pp_um": 8.45}, "", "exclude each other"),
        ({"shape": "step", "cycles": 3}, "/cycles", "be used with a step, which takes levels"),
        ({"levels_mN": [5.0]}, "/levels_mN", "cannot be used with a sinusoid"),
        ({"shape": "waypoints"}, "/points", "points is missing"),
        ({"x_points": POSITIONS}, "/x_points", "cannot be used with a sinusoid"),
        ({"x_points": POSITIONS, "points": FORCES}, "", "exclude each other"),
        (
            {"shape": "waypoints", "x_points": [POSITIONS[1], POSITIONS[0]]},
            "/x_points",
            "time from point 0 to point 1",
        ),
        (
            {
                "shape": "waypoints",
                "points": [{"t_s": 0, "force_mN": 1}, {"t_s": 0, "force_mN": 2}],
            },
            "/points",
            "time from point 0 to point 1 = 0.0 s, must be finite and above 0",
        ),
        (
            {"shape": "waypoints", "points": [{"t_s": 0, "force_mN": 1}, {"force_mN": 2}]},
            "/points/1/t_s",
            "t_s is missing",
        ),
        ({"frequency_hz": 0.001, "cycles": 10}, "/cycles", "the path takes 12000 s, limit 3600 s"),
    ],
)
def test_a_fault_of_a_track_is_reported_with_its_location(
    harness: Harness, wish: dict[str, Any], pointer: str, words: str
) -> None:
    problem = refused(harness, {"kind": "track", **wish})
    assert problem["type"] == "urn:pincette:problem:invalid-request"
    (error,) = problem["errors"]
    assert error["pointer"] == pointer
    assert words in error["message"]


@pytest.mark.parametrize(
    ("wish", "quantity", "pointer"),
    [
        ({"force_mean_mN": 35.0}, "force", "/force_pp_mN"),
        ({"force_mean_mN": 8.0}, "force", "/force_pp_mN"),
        ({"x_pp_um": 12.0}, "force", "/x_pp_um"),
        ({"frequency_hz": 2.5}, "rate", "/frequency_hz"),
        ({"shape": "step", "levels_mN": [5.0, 50.0]}, "force", "/levels_mN"),
        (
            {
                "shape": "waypoints",
                "points": [{"t_s": 0, "force_mN": 1}, {"t_s": 1, "force_mN": 45}],
            },
            "force",
            "/points",
        ),
        (
            {
                "shape": "waypoints",
                "x_points": [*POSITIONS, {"t_s": 3.0, "x_um": CONTACT_UM - 1.0}],
            },
            "force",
            "/x_points",
        ),
    ],
)
def test_the_refusal_of_a_path_beyond_a_limit_names_the_limit(
    harness: Harness, wish: dict[str, Any], quantity: str, pointer: str
) -> None:
    problem = refused(harness, {"kind": "track", **wish})
    assert problem["type"] == "urn:pincette:problem:limit-violation"
    places = {(v["quantity"], v["pointer"]) for v in problem["violations"]}
    assert (quantity, pointer) in places
    assert all(v["at_s"] > 0.0 for v in problem["violations"])


@pytest.mark.parametrize("shape", ["sinusoid", "triangle", "step"])
def test_a_dry_run_of_a_track_plans_the_path_of_the_rig_file(harness: Harness, shape: str) -> None:
    response = harness.post("/jobs", {"kind": "track", "shape": shape}, dry_run="true")
    assert response.status_code == 200
    plan = response.json()
    assert (plan["kind"], plan["feasible"]) == ("track", True)
    phases = [phase["phase"] for phase in plan["phases"]]
    assert phases[-6:] == ["load", "load", "settle", "track", "unload", "retreat"]
    highest = 20.0 if shape == "step" else 22.0
    assert max(plan["curves"]["force_r_mN"]) == pytest.approx(highest, rel=0.02)


@pytest.mark.parametrize(
    ("position", "force"),
    [
        ({"x_pp_um": 8.0}, {"force_pp_mN": 8.0 * K_E}),
        (
            {"shape": "waypoints", "x_points": POSITIONS},
            {"shape": "waypoints", "points": FORCES},
        ),
    ],
)
def test_the_force_of_a_path_follows_from_its_position(
    harness: Harness, position: dict[str, Any], force: dict[str, Any]
) -> None:
    by_position, by_force = (
        harness.post("/jobs", {"kind": "track", **one}, dry_run="true").json()
        for one in (position, force)
    )
    assert by_position["feasible"]
    assert by_position == by_force


def test_a_plan_states_the_effect_of_an_error_of_the_part(harness: Harness) -> None:
    plan = harness.post("/jobs", {"kind": "grip", "force_mN": 20.0}, dry_run="true").json()
    errors = plan["steady_errors"]
    # The part 3 µm away and 30 % softer than planned, by (51) and (52), K/K_f = 9.9505 mN/µm.
    softest = 2.17 * 0.7
    mismatch = 20.0 - softest * (20.0 / 2.17 - 3.0)
    worst_um = mismatch / (softest + 1.9901e4 / 2000.0)
    assert errors["position_max_um"] == pytest.approx(worst_um)
    assert errors["force_min_mN"] == pytest.approx(-1.9901e4 / 2000.0 * worst_um)
    assert errors["position_min_um"] < 0.0 < errors["force_max_mN"]


def test_a_request_with_countless_faults_gets_an_answer_of_bounded_length(harness: Harness) -> None:
    odd = {f"odd_{number}": 1 for number in range(3000)}
    response = harness.post("/jobs", {"kind": "grip", **odd})
    assert response.status_code == 413
    assert len(response.content) < 10_000
