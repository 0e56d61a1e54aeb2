"""Numbers of requests: JSON's own, finite, in bodies as in queries."""

from .harness import Harness

JSON = {"content-type": "application/json"}
PLAN = "/jobs?dry_run=true"
WAYPOINTS = '"points": [{"t_s": 0, "force_mN": 1}, {"t_s": %s, "force_mN": 1}]'
BODIES = (
    (PLAN, '{"kind": "grip", "force_mN": %s}'),
    (PLAN, '{"kind": "grip", "gains": {"K_P": %s}}'),
    (PLAN, '{"kind": "track", "cycles": %s}'),
    (PLAN, '{"kind": "track", "shape": "step", "levels_mN": [1, %s]}'),
    (PLAN, '{"kind": "track", "shape": "waypoints", ' + WAYPOINTS + "}"),
    (PLAN, '{"kind": "move", "to_um": %s}'),
    (PLAN, '{"kind": "calibrate", "calibration": "compliance", "weights_mN": [0, %s]}'),
    (PLAN, '{"kind": "calibrate", "calibration": "residual", "runs": %s}'),
    ("/recipes", '{"name": "a", "values": {"force_mN": %s}}'),
    ("/recipes", '{"name": "a", "values": {"part": {"contact_um": %s}}}'),
    ("/trajectories?dry_run=true", '{"kind": "grip", "hold_s": %s}'),
)
NO_NUMBERS = ("true", '"5"', '"2,5"', "NaN", "Infinity", "-Infinity", "1e400", "9" * 400, "[5]")


def answer(harness: Harness, path: str, body: str) -> int:
    """Send a body, and return the status of the reply."""
    url = f"/api/v1{path}"
    return harness.call("POST", url, content=body, headers=JSON).status_code


def test_invalid_numbers_of_json_are_refused(harness: Harness) -> None:
    taken = [
        (path, body, text)
        for path, body in BODIES
        for text in NO_NUMBERS
        if answer(harness, path, body % text) != 422
    ]
    assert taken == []


def test_whole_and_decimal_numbers_are_equal(harness: Harness) -> None:
    for text in ("2", "2.0", "2e0"):
        assert answer(harness, PLAN, f'{{"kind": "track", "cycles": {text}}}') == 200


def test_a_number_of_a_query_has_the_form_of_json(harness: Harness) -> None:
    for text in ("1_0", "%205", "5%20", "5.0", "%2B5", "%EF%BC%95", "0x10", "5,0", ""):
        response = harness.call("GET", f"/api/v1/jobs?limit={text}")
        assert response.status_code == 422, text
        assert response.json()["errors"][0]["message"].startswith("limit = ")
    for text in ("1_0", "%205", "2,5", ".5", "5.", "nan", "inf", "1e400", "5s"):
        response = harness.call("GET", f"/api/v1/rigs/demo/history?hours={text}")
        assert response.status_code == 422, text
    for path in ("jobs?limit=5", "rigs/demo/history?hours=0.5", "rigs/demo/history?hours=1e0"):
        assert harness.call("GET", f"/api/v1/{path}").status_code == 200
