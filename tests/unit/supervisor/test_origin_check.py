"""Host names under which a supervisor accepts requests, and pages that may change something."""

from typing import Any

import pytest

from pincette.config import RigFile
from pincette_supervisor.access.access import Access, is_foreign, is_loopback, is_ours
from tests.support.apps import create_app

from .harness import Harness

NAMES = frozenset({"gripper.lab"})


@pytest.mark.parametrize(
    "place",
    [
        "localhost",
        "LOCALHOST:8000",
        "127.0.0.1:8000",
        "[::1]:8000",
        "192.168.1.20:8000",
        "gripper.lab",
        "Gripper.Lab:8000",
    ],
)
def test_host_names_of_this_machine_are_accepted(place: str) -> None:
    assert is_ours(place, NAMES)


@pytest.mark.parametrize(
    "place",
    [
        "",
        "evil.example",
        "evil.example:8000",
        "localhost.evil.example",
        "127.0.0.1.evil.example",
        "evil.example@localhost",
        "localhost@evil.example",
        "localhost:8000/evil",
        "localhost:port",
        "[::1",
        "localhost, evil.example",
        "gripper.lab.",
    ],
)
def test_foreign_host_names_are_refused(place: str) -> None:
    assert not is_ours(place, NAMES)


@pytest.mark.parametrize(
    ("host", "alone"),
    [
        ("127.0.0.1", True),
        ("127.1.2.3", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.1.20", False),
        ("gripper.lab", False),
    ],
)
def test_loopback_addresses_are_recognized(host: str, alone: bool) -> None:
    assert is_loopback(host) is alone


@pytest.mark.parametrize(
    ("site", "origin", "foreign"),
    [
        (None, None, False),  # curl, and this project's client
        ("same-origin", "http://localhost:8000", False),
        ("none", None, False),
        ("same-site", "http://localhost:3000", True),
        ("cross-site", None, True),
        ("cross-site", "http://localhost:8000", True),
        (None, "http://localhost:8000", False),
        (None, "https://localhost:8000", False),  # a proxy before it speaks TLS
        (None, "http://localhost:3000", True),
        (None, "http://evil.example", True),
        (None, "null", True),
        (None, "", True),
        (None, "http://[", True),
    ],
)
def test_pages_of_other_origins_are_refused(
    site: str | None, origin: str | None, foreign: bool
) -> None:
    assert is_foreign(site, origin, "localhost:8000") is foreign


def test_a_request_with_a_foreign_host_name_is_refused(harness: Harness) -> None:
    for method, path in (("GET", "/api/v1/rigs"), ("POST", "/api/v1/jobs"), ("GET", "/")):
        answer = harness.call(method, path, headers={"Host": "evil.example"}, json={"kind": "grip"})
        assert answer.status_code == 421
        assert answer.headers["content-type"] == "application/problem+json"
        assert "evil.example" in answer.json()["detail"]
    assert harness.get("/jobs")["jobs"] == []


def test_a_name_of_the_rig_file_is_accepted(harness: Harness) -> None:
    harness.app = create_app(harness.rigs, Access(names=NAMES))
    assert harness.call("GET", "/api/v1/rigs", headers={"Host": "gripper.lab"}).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site", "Origin": "http://localhost:3000"},
    ],
)
def test_a_page_of_another_site_cannot_start_a_grip_even_without_keys(
    harness: Harness, headers: dict[str, str]
) -> None:
    grip = {"kind": "grip", "autostart": True}
    answer = harness.call("POST", "/api/v1/jobs", json=grip, headers=headers)
    assert (answer.status_code, answer.json()["type"]) == (403, "urn:pincette:problem:foreign-page")
    assert harness.get("/jobs")["jobs"] == []


def test_the_supervisors_page_can_start_a_grip(harness: Harness) -> None:
    headers = {"Origin": "http://localhost", "Sec-Fetch-Site": "same-origin"}
    answer = harness.call("POST", "/api/v1/jobs", json={"kind": "grip"}, headers=headers)
    assert answer.status_code == 201


def test_cors_permits_nothing_to_a_page_of_another_origin(harness: Harness) -> None:
    values: dict[str, Any] = {
        "Origin": "http://evil.example",
        "Access-Control-Request-Method": "POST",
        "Access-Control-Request-Headers": "content-type",
    }
    for method in ("OPTIONS", "GET"):
        answer = harness.call(method, "/api/v1/jobs", headers=values)
        assert not [name for name in answer.headers if name.startswith("access-control")]


def test_every_response_has_security_headers(harness: Harness, rig_file: RigFile) -> None:
    for path in ("/api/v1/rigs", "/api/v1/nothing", f"/api/v1/rigs/{rig_file.rig.name}", "/livez"):
        headers = harness.call("GET", path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["cache-control"] == "no-store"
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert headers["referrer-policy"] == "same-origin"
        assert headers["cross-origin-resource-policy"] == "same-origin"
    page = harness.call("GET", "/").headers
    policy = page["content-security-policy"]
    assert "default-src 'none'; script-src 'self'" in policy
    assert "unsafe" not in policy
    assert page["cache-control"] == "no-cache"
    assert page["x-content-type-options"] == "nosniff"
