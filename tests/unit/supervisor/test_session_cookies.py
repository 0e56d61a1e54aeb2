"""A browser that is signed in to several supervisors of one host stays signed in to each."""

from collections.abc import Generator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest

from pincette.config import RigFile
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.authentication import Authenticator
from tests.support.apps import create_app
from tests.support.keys import ScopeKeys, key_of_each_scope
from tests.support.served import served

from .harness import Harness

SESSION = "/api/v1/session"
Place = tuple[str, ScopeKeys]


def keyed(harness: Harness) -> ScopeKeys:
    access = Access(Authenticator(supervisor=harness.store.identifier()))
    harness.app = create_app(harness.rigs, access)
    return key_of_each_scope(harness.store, access.authenticator)


@pytest.fixture
def both(tmp_path: Path, rig_file: RigFile) -> Generator[list[Place]]:
    """Two supervisors of rigs of the same name, at two ports of one host."""
    with ExitStack() as stack:
        places: list[Place] = []
        for name in ("one", "other"):
            (tmp_path / name).mkdir()
            harness = Harness(rig_file, tmp_path / name)
            stack.callback(harness.close)
            ring = keyed(harness)
            places.append((stack.enter_context(served(harness.app)), ring))
        yield places


def test_two_supervisors_of_one_host_keep_a_browser_signed_in(both: list[Place]) -> None:
    with httpx.Client() as browser:
        for address, ring in both:
            headers = {**ring.headers("operate"), "Origin": address}
            assert browser.post(address + SESSION, headers=headers).status_code == 200
        for address, _ in both:
            assert browser.get(address + SESSION).json()["signed_in"] is True
            assert browser.get(f"{address}/api/v1/rigs").status_code == 200
        (one, _), (other, _) = both
        assert browser.delete(one + SESSION).status_code == 200
        assert browser.get(one + SESSION).json()["signed_in"] is False
        assert browser.get(other + SESSION).json()["signed_in"] is True


def test_a_browser_can_sign_in_at_every_address_of_a_supervisor(both: list[Place]) -> None:
    (address, ring), _ = both
    with httpx.Client() as browser:
        for one in (address, address.replace("127.0.0.1", "localhost")):
            assert browser.post(one + SESSION, headers=ring.headers("observe")).status_code == 200
        for one in (address, address.replace("127.0.0.1", "localhost")):
            assert browser.get(one + SESSION).json()["signed_in"] is True


def test_pages_with_and_without_tls_have_separate_cookies(harness: Harness) -> None:
    ring = keyed(harness)
    name = f"pincette_session_{harness.store.identifier()}"
    values: dict[str, str] = {}
    for scheme, full in (("http", name), ("https", f"__Host-{name}")):
        headers = {**ring.headers("observe"), "Origin": f"{scheme}://localhost"}
        stated = harness.call("POST", SESSION, headers=headers).headers["set-cookie"]
        assert stated.startswith(f"{full}=")
        assert ("Secure" in stated) == (scheme == "https")
        assert "Path=/" in stated
        assert "Domain" not in stated
        values[full] = stated.partition("=")[2].partition(";")[0]
    cookies = "; ".join(f"{one}={value}" for one, value in values.items())
    for one, value in values.items():
        found = harness.call("GET", SESSION, headers={"Cookie": f"{one}={value}"})
        assert found.json()["signed_in"] is True
    stale = {"Cookie": f"__Host-{name}=stale; {name}={values[name]}"}
    assert harness.call("GET", SESSION, headers=stale).json()["signed_in"] is True
    out = harness.call("DELETE", SESSION, headers={"Cookie": cookies})
    deleted = out.headers.get_list("set-cookie")
    assert len(deleted) == 2
    assert all("Secure" in one for one in deleted if one.startswith("__Host-"))
    for one, value in values.items():
        found = harness.call("GET", SESSION, headers={"Cookie": f"{one}={value}"})
        assert found.json()["signed_in"] is False


def test_a_cookie_of_another_supervisor_gives_no_access(harness: Harness) -> None:
    ring = keyed(harness)
    stated = harness.call("POST", SESSION, headers=ring.headers("observe")).headers["set-cookie"]
    value = stated.partition("=")[2].partition(";")[0]
    for name in ("pincette_session", "pincette_session_0123456789abcdef"):
        found = harness.call("GET", SESSION, headers={"Cookie": f"{name}={value}"})
        assert found.json()["signed_in"] is False
