"""Every route states its required scope, and enforces it; actions are stored with their caller."""

from itertools import product
from typing import Any

import httpx
from fastapi.routing import APIRoute
from starlette.routing import BaseRoute

from pincette.api.access import SCOPES, Scope, covers
from pincette_supervisor.rest.dependencies import COOKIE
from pincette_supervisor.rest.strict_route import StrictRoute
from tests.support.api_document import openapi
from tests.support.keys import ScopeKeys, shown

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
    ("post", "/api/v1/rigs/{rig}/page-check"): "a page must learn whether its stop would arrive",
    ("delete", "/api/v1/session"): "gives up a cookie, whosever it is",
}
"""Operations without a required scope, each with the reason."""
UNDESCRIBED = {
    "/",
    "/favicon.ico",
    "/page/days",
    "/page/points",
    "/page/{name:path}",
    "/openapi.json",
    "/.well-known/wot",
}
"""Routes outside the description: the page's files and helpers, and descriptions. All but
``/page/points``, which needs the scope ``operate``, are public."""
DEMANDS: dict[str, set[tuple[str, str]]] = {
    "propose": {("post", "/api/v1/jobs"), ("post", "/api/v1/trajectories/plot")},
    "admin": {
        ("post", "/api/v1/calibrations/{calibration}/actions"),
        ("post", "/api/v1/rigs/{rig}/model/actions"),
        ("delete", "/api/v1/jobs/{job}/record"),
        ("get", "/api/v1/audit"),
        ("get", "/api/v1/audit/chain"),
    },
}
"""Exceptions to the rule that reading needs ``observe`` and the rest ``operate``."""


def operations() -> dict[tuple[str, str], Any]:
    paths: dict[str, Any] = openapi()["paths"]
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


def test_every_operation_requires_a_scope_or_is_listed_as_open() -> None:
    found = {place: demanded(one) for place, one in operations().items()}
    assert {place for place, scope in found.items() if scope is None} == set(OPEN)
    for place, scope in found.items():
        expected = "observe" if place[0] == "get" else "operate"
        for other, places in DEMANDS.items():
            expected = other if place in places else expected
        assert scope in (expected, None), place


def test_every_route_is_described(harness: Harness) -> None:
    undescribed = {
        getattr(route, "path", "")
        for route in every_route(harness.app.routes)
        if not (isinstance(route, APIRoute) and route.include_in_schema)
    }
    assert undescribed == UNDESCRIBED


def test_every_route_refuses_what_it_does_not_know(harness: Harness) -> None:
    routes = [one for one in every_route(harness.app.routes) if isinstance(one, APIRoute)]
    assert {one.path for one in routes if not isinstance(one, StrictRoute)} == set()


def test_the_api_description_states_how_a_key_is_sent() -> None:
    tree = openapi()
    schemes = tree["components"]["securitySchemes"]
    assert (schemes["key"]["type"], schemes["key"]["scheme"]) == ("http", "bearer")
    assert (schemes["session"]["in"], schemes["session"]["name"]) == ("cookie", COOKIE)
    for place, one in operations().items():
        wanted = {"403", "421", "429", *({"401"} if demanded(one) else ())}
        assert wanted <= one["responses"].keys(), place


def test_a_too_small_scope_is_refused_before_anything_is_read(
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


def test_an_observer_can_read_and_stop_only(harness: Harness, ring: ScopeKeys) -> None:
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


def test_the_key_names_the_caller_and_a_label_is_added(harness: Harness, ring: ScopeKeys) -> None:
    headers = {**ring.headers("operate"), "X-Operator": "an-admin"}
    job = harness.call("POST", "/api/v1/jobs", json={"kind": "grip"}, headers=headers)
    assert job.status_code == 201
    assert job.json()["by"] == "an-operate (an-admin)"
    harness.reach(job.json()["id"], "ready")
    place = f"/api/v1/jobs/{job.json()['id']}/actions"
    acted = harness.call("POST", place, json={"type": "stop"}, headers=headers)
    assert acted.json()["actions"][-1]["by"] == "an-operate (an-admin)"


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
    header = answer.headers["set-cookie"]
    assert "HttpOnly" in header
    assert "SameSite=strict" in header
    assert "Path=/" in header
    assert "Secure" not in header
    cookie = {"Cookie": f"{COOKIE}={answer.cookies[COOKIE]}"}
    assert ring.keys["operate"] not in header
    found = harness.call("GET", "/api/v1/session", headers=cookie).json()
    assert (found["name"], found["scope"], found["signed_in"]) == ("an-operate", "operate", True)
    assert harness.call("GET", "/api/v1/rigs", headers=cookie).status_code == 200
    assert harness.call("POST", "/api/v1/estop", headers=cookie).status_code == 200
    assert harness.call("GET", "/api/v1/audit", headers=cookie).status_code == 403
    assert harness.call("DELETE", "/api/v1/session", headers=cookie).status_code == 200
    assert harness.call("GET", "/api/v1/rigs", headers=cookie).status_code == 401


def test_over_tls_the_cookie_is_sent_to_this_supervisor_only(
    harness: Harness, ring: ScopeKeys
) -> None:
    headers = {**ring.headers("observe"), "Origin": "https://localhost"}
    answer = harness.call("POST", "/api/v1/session", headers=headers)
    assert "Secure" in answer.headers["set-cookie"]


def test_no_page_signs_in_with_a_wrong_key_or_from_another_origin(
    harness: Harness, ring: ScopeKeys
) -> None:
    wrong = shown(f"{ring.keys['admin']}x")
    answer = harness.call("POST", "/api/v1/session", headers=wrong)
    assert (answer.status_code, "set-cookie" in answer.headers) == (401, False)
    assert ring.keys["admin"] not in answer.text
    foreign = {**ring.headers("admin"), "Origin": "http://evil.example"}
    assert harness.call("POST", "/api/v1/session", headers=foreign).status_code == 403


def test_without_keys_a_page_needs_no_sign_in(harness: Harness) -> None:
    assert harness.get("/session") == {
        "keys": False,
        "name": None,
        "scope": "admin",
        "signed_in": False,
    }
    answer = harness.call("POST", "/api/v1/session")
    assert (answer.status_code, "set-cookie" in answer.headers) == (200, False)
