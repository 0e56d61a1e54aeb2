"""Every route says what it demands, and holds to it; what is done is kept with whose it was."""

import json
import sqlite3
from contextlib import closing
from itertools import product
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi.routing import APIRoute
from starlette.routing import BaseRoute

from pincette.api.access import SCOPES, Scope, covers
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from pincette_supervisor.journal.access_rows import AuditRepository, AuditRow
from pincette_supervisor.rest.api import create_app
from pincette_supervisor.rest.dependencies import COOKIE
from pincette_supervisor.rest.openapi import document
from tests.support.keys import ScopeKeys, key_of_each_scope, shown

from .harness import Harness

OPEN = {
    ("get", "/livez"): "a probe has no key, and learns one word",
    ("get", "/readyz"): "a probe has no key",
    ("get", "/version"): "who has no key yet must learn whom it speaks with",
    ("get", "/asyncapi.json"): "a description that is in the repository",
    ("get", "/api/v1/session"): "a page must learn that a key is wanted",
    ("post", "/api/v1/session"): "demands a key by itself, of any scope",
    ("post", "/api/v1/estop"): "whoever sees danger may stop, known or not",
    ("post", "/api/v1/rigs/{rig}/estop"): "whoever sees danger may stop, known or not",
    ("delete", "/api/v1/session"): "gives up a cookie, whosever it is",
}
"""Operations that demand nothing, each with why not."""
UNDESCRIBED = {"/", "/favicon.ico", "/page/{name:path}", "/openapi.json"}
"""Routes outside the description: the page's files, and the description, which are public."""
DEMANDS: dict[str, set[tuple[str, str]]] = {
    "admin": {
        ("post", "/api/v1/calibrations/{calibration}/actions"),
        ("post", "/api/v1/rigs/{rig}/model/actions"),
        ("delete", "/api/v1/jobs/{job}/record"),
        ("get", "/api/v1/audit"),
        ("get", "/api/v1/audit/chain"),
    },
}
"""What is not as its method lets one expect: reading observes, the rest operates."""


def operations() -> dict[tuple[str, str], Any]:
    paths: dict[str, Any] = json.loads(document())["paths"]
    return {(method, path): one for path, of in paths.items() for method, one in of.items()}


def demanded(operation: Any) -> Scope | None:
    ways: list[dict[str, list[Any]]] = operation.get("security", [])
    if not ways:
        return None
    scopes = {way[name][0] for way in ways for name in way}
    assert {name for way in ways for name in way} == {"key", "session"}
    (scope,) = scopes
    return scope


def every_route(routes: list[BaseRoute]) -> list[BaseRoute]:
    found: list[BaseRoute] = []
    for route in routes:
        below = getattr(route, "original_router", None)
        found += [route] if below is None else every_route(below.routes)
    return found


@pytest.fixture
def ring(harness: Harness) -> ScopeKeys:
    access = Access(Authenticator())
    harness.app = create_app(harness.rigs, access)
    return key_of_each_scope(harness.store, access.authenticator)


def test_every_operation_demands_a_scope_or_stands_in_the_list() -> None:
    found = {place: demanded(one) for place, one in operations().items()}
    assert {place for place, scope in found.items() if scope is None} == set(OPEN)
    for place, scope in found.items():
        expected = "observe" if place[0] == "get" else "operate"
        for other, places in DEMANDS.items():
            expected = other if place in places else expected
        assert scope in (expected, None), place


def test_no_route_is_left_out_of_the_description(harness: Harness) -> None:
    undescribed = {
        getattr(route, "path", "")
        for route in every_route(harness.app.routes)
        if not (isinstance(route, APIRoute) and route.include_in_schema)
    }
    assert undescribed == UNDESCRIBED


def test_the_description_names_how_a_key_is_shown() -> None:
    tree = json.loads(document())
    schemes = tree["components"]["securitySchemes"]
    assert (schemes["key"]["type"], schemes["key"]["scheme"]) == ("http", "bearer")
    assert (schemes["session"]["in"], schemes["session"]["name"]) == ("cookie", COOKIE)
    for place, one in operations().items():
        wanted = {"403", "421", "429", *({"401"} if demanded(one) else ())}
        assert wanted <= one["responses"].keys(), place


def test_whoever_has_too_small_a_scope_is_refused_before_anything_is_looked_at(
    harness: Harness, ring: ScopeKeys
) -> None:
    for (method, path), operation in operations().items():
        needed = demanded(operation)
        if needed is None:
            continue
        refused: list[tuple[str, dict[str, str]]] = [("none", {}), ("wrong", shown("wrong"))]
        key = ring.keys["admin"]
        refused += [("bare", {"Authorization": key}), ("basic", {"Authorization": f"Basic {key}"})]
        refused += [(scope, ring.headers(scope)) for scope in SCOPES if not covers(scope, needed)]
        wrong: dict[str, Any] = {"params": {"nobody": "knows"}, "content": b"{"}
        for (name, headers), details in product(refused, ({}, wrong)):
            answer = harness.call(method.upper(), path, headers=headers, **details)
            assert answer.status_code == (403 if name in SCOPES else 401), (name, answer.text)
            assert answer.headers["content-type"] == "application/problem+json"
            assert answer.headers["www-authenticate"].startswith('Bearer realm="pincette"')
            assert answer.json()["needed_scope"] == needed
    assert harness.told("alarm") == []


def test_an_observer_sees_and_stops_and_nothing_else(harness: Harness, ring: ScopeKeys) -> None:
    seen = ring.headers("observe")
    assert harness.call("GET", "/api/v1/rigs", headers=seen).status_code == 200
    assert harness.call("POST", "/api/v1/rigs/demo/estop", headers=seen).status_code == 200
    assert harness.call("POST", "/api/v1/estop", headers=seen).status_code == 200
    answer = harness.call(
        "POST", "/api/v1/rigs/demo/reset", headers=seen, json={"acknowledge": True}
    )
    assert answer.status_code == 403
    assert "needs scope operate" in answer.json()["detail"]
    assert "key 'an-observe' has observe" in answer.json()["detail"]


def test_the_key_is_who_asked_and_a_label_stands_beside_it(
    harness: Harness, ring: ScopeKeys
) -> None:
    headers = {**ring.headers("operate"), "X-Operator": "an-admin"}
    job = harness.call("POST", "/api/v1/jobs", json={"kind": "grip"}, headers=headers)
    assert job.status_code == 201
    assert job.json()["by"] == "an-operate (an-admin)"
    harness.reach(job.json()["id"], "ready")
    place = f"/api/v1/jobs/{job.json()['id']}/actions"
    acted = harness.call("POST", place, json={"type": "stop"}, headers=headers)
    assert acted.json()["actions"][-1]["by"] == "an-operate (an-admin)"


def audit(harness: Harness, ring: ScopeKeys, **query: Any) -> list[dict[str, Any]]:
    answer = harness.call("GET", "/api/v1/audit", headers=ring.headers("admin"), params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()["entries"]


def test_what_is_done_is_kept(harness: Harness, ring: ScopeKeys) -> None:
    headers = ring.headers("operate")
    body = {"kind": "grip", "dry_run": True}
    harness.call("POST", "/api/v1/jobs", json=body, headers=headers)
    made = harness.call("POST", "/api/v1/jobs", json={"kind": "grip"}, headers=headers).json()["id"]
    harness.reach(made, "ready")
    harness.call("POST", f"/api/v1/jobs/{made}/actions", json={"type": "stop"}, headers=headers)
    harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    harness.call("GET", "/api/v1/rigs", headers=headers)
    found = [
        (one["who"], one["action"], one["detail"], one["status"]) for one in audit(harness, ring)
    ]
    assert found == [
        ("an-observe", "POST /api/v1/estop", "", 200),
        ("an-operate", f"POST /api/v1/jobs/{made}/actions", "stop", 202),
        ("an-operate", "POST /api/v1/jobs", f"grip {made}", 201),
    ]
    first = audit(harness, ring, limit=1)
    assert len(first) == 1
    rest = audit(harness, ring, before=first[0]["number"])
    assert [one["number"] for one in rest] == [2, 1]


def test_a_stranger_who_insists_fills_no_log(harness: Harness, ring: ScopeKeys) -> None:
    for number in range(50):
        headers = {"X-Operator": f"an-admin {number}"}
        harness.call("GET", f"/api/v1/jobs/{number}", headers=headers)
    (entry,) = audit(harness, ring)
    assert (entry["who"], entry["status"], entry["count"]) == ("127.0.0.1", 401, 50)


def test_the_log_is_only_added_to(harness: Harness, ring: ScopeKeys, tmp_path: Path) -> None:
    harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    assert len(audit(harness, ring)) == 1
    with closing(sqlite3.connect(tmp_path / "supervisor.sqlite")) as base:
        for change in ("UPDATE audit SET who = 'nobody'", "DELETE FROM audit"):
            with pytest.raises(sqlite3.IntegrityError, match="audit log"):
                base.execute(change)
    assert audit(harness, ring)[0]["who"] == "an-observe"


def test_stops_of_a_stranger_are_told_once_and_beside_those_of_others(
    harness: Harness, ring: ScopeKeys
) -> None:
    for _ in range(50):
        assert harness.call("POST", "/api/v1/estop").status_code == 200
    harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    found = {(one["who"], one["action"], one["count"]) for one in audit(harness, ring)}
    assert found == {
        ("127.0.0.1", "POST /api/v1/estop", 50),
        ("an-observe", "POST /api/v1/estop", 1),
    }


def chain(harness: Harness, ring: ScopeKeys, **query: str) -> dict[str, Any]:
    headers = ring.headers("admin")
    answer = harness.call("GET", "/api/v1/audit/chain", headers=headers, params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


TRIGGERS = ("audit_is_append_only", "audit_keeps_the_newest")
DAMAGES = [
    ("UPDATE audit SET who = 'nobody' WHERE number = 3", 3),
    ("UPDATE audit SET status = 403 WHERE number = 5", 5),
    ("UPDATE audit SET count = 2 WHERE number = 2", 2),
    ("DELETE FROM audit WHERE number = 3", 4),
    ("UPDATE audit SET link = 'x' WHERE number = 4", 4),
    ("UPDATE audit SET number = 9 WHERE number = 5", 9),
    (
        "UPDATE audit SET number = 8 WHERE number = 3; "
        "UPDATE audit SET number = 3 WHERE number = 4; "
        "UPDATE audit SET number = 4 WHERE number = 8",
        3,
    ),
]


@pytest.mark.parametrize(("damage", "broken"), DAMAGES)
def test_what_was_changed_in_the_file_is_found(
    harness: Harness, ring: ScopeKeys, tmp_path: Path, damage: str, broken: int
) -> None:
    for _ in range(5):
        harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    whole = chain(harness, ring)
    assert (whole["entries"], whole["first"], whole["newest"]) == (5, 1, 5)
    assert whole["broken"] is None
    with closing(sqlite3.connect(tmp_path / "supervisor.sqlite")) as base:
        for trigger in TRIGGERS:
            base.execute(f"DROP TRIGGER {trigger}")
        base.executescript(damage)
        base.commit()
    assert chain(harness, ring)["broken"] == broken


def test_a_log_that_is_written_anew_lacks_the_link_that_was_noted(
    harness: Harness, ring: ScopeKeys
) -> None:
    harness.call("POST", "/api/v1/estop", headers=ring.headers("observe"))
    noted = chain(harness, ring)["link"]
    harness.call("POST", "/api/v1/estop", headers=ring.headers("operate"))
    assert chain(harness, ring, link=noted)["found"] is True
    assert chain(harness, ring, link="0" * 64)["found"] is False
    assert chain(harness, ring)["found"] is None


MANY = """
WITH RECURSIVE counted(number) AS (SELECT 1 UNION ALL SELECT number + 1 FROM counted LIMIT 200004)
INSERT INTO audit (at, who, address, action, detail, status, count, link)
SELECT '2026-03-01T12:00:00.000Z', 'ann', '127.0.0.1', 'POST /estop', '', 200, 1, '' FROM counted
"""


def test_the_oldest_of_very_many_entries_go(
    harness: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pincette_supervisor.journal.access_rows.AUDIT_SWEEP", 0)
    with harness.store.writing() as base:
        base.exec_driver_sql(MANY)
    AuditRepository(harness.store).add(
        [AuditRow("2026", "ann", "127.0.0.1", "POST /estop", "", 200)]
    )
    with harness.store.reading() as base:
        count = base.exec_driver_sql("SELECT count(*), min(number) FROM audit").one()
    assert tuple(count) == (200_000, 6)


def signed_in(harness: Harness, ring: ScopeKeys, scope: Scope) -> httpx.Response:
    answer = harness.call("POST", "/api/v1/session", headers=ring.headers(scope))
    assert answer.status_code == 200
    return answer


def test_a_page_signs_in_and_out(harness: Harness, ring: ScopeKeys) -> None:
    assert harness.call("GET", "/api/v1/session").json() == {
        "keys": True,
        "name": None,
        "scope": None,
        "signed_in": False,
    }
    answer = signed_in(harness, ring, "operate")
    said = answer.headers["set-cookie"]
    assert "HttpOnly" in said
    assert "SameSite=strict" in said
    assert "Path=/" in said
    assert "Secure" not in said
    cookie = {"Cookie": f"{COOKIE}={answer.cookies[COOKIE]}"}
    assert ring.keys["operate"] not in said
    found = harness.call("GET", "/api/v1/session", headers=cookie).json()
    assert (found["name"], found["scope"], found["signed_in"]) == ("an-operate", "operate", True)
    assert harness.call("GET", "/api/v1/rigs", headers=cookie).status_code == 200
    assert harness.call("POST", "/api/v1/estop", headers=cookie).status_code == 200
    assert harness.call("GET", "/api/v1/audit", headers=cookie).status_code == 403
    assert harness.call("DELETE", "/api/v1/session", headers=cookie).status_code == 200
    assert harness.call("GET", "/api/v1/rigs", headers=cookie).status_code == 401


def test_over_tls_the_cookie_goes_nowhere_else(harness: Harness, ring: ScopeKeys) -> None:
    headers = {**ring.headers("observe"), "Origin": "https://localhost"}
    answer = harness.call("POST", "/api/v1/session", headers=headers)
    assert "Secure" in answer.headers["set-cookie"]


def test_no_page_signs_in_with_a_wrong_key_or_from_elsewhere(
    harness: Harness, ring: ScopeKeys
) -> None:
    wrong = shown(f"{ring.keys['admin']}x")
    answer = harness.call("POST", "/api/v1/session", headers=wrong)
    assert (answer.status_code, "set-cookie" in answer.headers) == (401, False)
    assert ring.keys["admin"] not in answer.text
    foreign = {**ring.headers("admin"), "Origin": "http://evil.example"}
    assert harness.call("POST", "/api/v1/session", headers=foreign).status_code == 403


def test_without_keys_a_page_needs_none(harness: Harness) -> None:
    assert harness.get("/session") == {
        "keys": False,
        "name": None,
        "scope": "admin",
        "signed_in": False,
    }
    answer = harness.call("POST", "/api/v1/session")
    assert (answer.status_code, "set-cookie" in answer.headers) == (200, False)
