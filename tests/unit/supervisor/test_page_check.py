"""A page learns at load whether its stop and its requests would be accepted, and why not."""

from collections.abc import Callable
from typing import Any

import pytest

from pincette.config import RigFile
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from tests.support.apps import create_app
from tests.support.keys import ScopeKeys, key_of_each_scope

from .harness import Harness

PLACE = "/api/v1/rigs/demo/page-check"
OWN = {"Host": "gripper.lab", "Origin": "http://gripper.lab"}
DROPPED = {"Host": "127.0.0.1:8000", "Origin": "http://gripper.lab"}
NO_PORT = {"Host": "gripper.lab", "Origin": "http://gripper.lab:8080"}
UNKNOWN = {"Host": "other.lab", "Origin": "http://other.lab"}
FOREIGN = {"Host": "gripper.lab", "Origin": "http://evil.example"}
CROSS_SITE = {"Host": "gripper.lab", "Sec-Fetch-Site": "cross-site"}
TLS_PROXY = {
    "Host": "127.0.0.1:8000",
    "Origin": "https://gripper.lab",
    "Sec-Fetch-Site": "same-origin",
}
NO_HOST = {"Host": "", "Origin": "http://gripper.lab"}
CASES = [
    (OWN, None, None),
    (TLS_PROXY, None, None),
    (DROPPED, "foreign-page", "foreign-page"),
    (NO_PORT, "foreign-page", "foreign-page"),
    (FOREIGN, "foreign-page", "foreign-page"),
    (CROSS_SITE, "foreign-page", "foreign-page"),
    (UNKNOWN, None, "foreign-host"),
    (NO_HOST, None, "foreign-host"),
]


@pytest.fixture
def named(harness: Harness) -> Harness:
    access = Access(Authenticator(supervisor="5f"), names=frozenset({"gripper.lab"}))
    harness.app = create_app(harness.rigs, access)
    return harness


def code_of(answer: Any) -> str | None:
    if answer.status_code in (403, 421):
        return str(answer.json()["type"]).rpartition(":")[2]
    assert answer.status_code in (200, 409), answer.text
    return None


@pytest.mark.parametrize(("headers", "stop", "order"), CASES)
def test_the_page_check_predicts_which_requests_are_accepted(
    named: Harness, headers: dict[str, str], stop: str | None, order: str | None
) -> None:
    found = named.call("POST", PLACE, headers=headers)
    assert found.status_code == 200
    tree = found.json()
    assert (tree["stop"]["code"], tree["order"]["code"]) == (stop, order)
    assert (tree["stop"]["accepted"], tree["order"]["accepted"]) == (stop is None, order is None)
    assert (tree["rig"], tree["supervisor"], tree["path"]) == ("demo", "5f", PLACE)
    assert (tree["host"], tree["origin"]) == (headers["Host"], headers.get("Origin"))
    real = named.call("POST", "/api/v1/rigs/demo/estop", headers=headers)
    assert code_of(real) == stop
    if stop is None:
        assert (real.json()["rig"], real.json()["supervisor"]) == ("demo", "5f")
    reset = named.call(
        "POST", "/api/v1/rigs/demo/reset", headers=headers, json={"acknowledge": True}
    )
    assert code_of(reset) == order


def test_a_missing_host_header_is_reported_with_the_proxy_setting_to_add(named: Harness) -> None:
    stop = named.call("POST", PLACE, headers=DROPPED).json()["stop"]
    assert "127.0.0.1:8000" in stop["detail"]
    assert "http://gripper.lab" in stop["detail"]
    assert "proxy_set_header Host $http_host;" in stop["remedy"]


def test_the_page_check_moves_nothing_and_is_not_audited(named: Harness) -> None:
    key_of_each_scope(named.store, Authenticator())
    assert named.call("POST", PLACE, headers=OWN).status_code == 200
    assert named.told("alarm") == []
    assert not named.health.latch().reason.cause.value.startswith("estop")


def test_without_a_key_a_stop_is_accepted_and_another_request_is_not(
    harness: Harness, ring: ScopeKeys
) -> None:
    codes = {
        scope: harness.call("POST", PLACE, headers=ring.headers(scope)).json()["order"]["code"]
        for scope in ("observe", "operate", "admin")
    }
    assert codes == {"observe": "scope-too-small", "operate": None, "admin": None}
    found = harness.call("POST", PLACE).json()
    assert (found["stop"]["accepted"], found["order"]["code"]) == (True, "no-key")


def test_an_unknown_rig_and_a_wrong_path_are_problems(named: Harness) -> None:
    for path in ("/api/v1/rigs/none/page-check", f"/gripper{PLACE}", f"{PLACE}/"):
        answer = named.call("POST", path, headers=OWN)
        assert (answer.status_code, answer.headers["content-type"]) == (
            404,
            "application/problem+json",
        )


def test_every_stop_and_the_page_name_the_supervisor(named: Harness) -> None:
    assert named.call("POST", "/api/v1/estop", headers=OWN).json()["supervisor"] == "5f"
    assert "{{" not in named.call("GET", "/", headers=OWN).text


def test_a_supervisor_keeps_its_identifier(
    rig_file: RigFile, open_harness: Callable[..., Harness]
) -> None:
    first = open_harness(rig_file)
    identifier = first.store.identifier()
    assert len(identifier) == 16
    assert first.store.identifier() == identifier
