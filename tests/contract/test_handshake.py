"""Messages that say why two programs cannot connect, from real handshakes with Zenoh that fail."""

import shutil
from collections.abc import Generator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import pytest

from pincette.bus.handshake import diagnose_link
from pincette.bus.protocol import BusError
from pincette.bus.session import open_session
from pincette.bus.topology import TlsIdentity, client_session, endpoint, router_session, secured
from pincette.security.establishing import establish
from pincette.security.folder import Folder
from pincette.security.identity import Credentials, program
from tests.support.certificates import NOW, folder_for
from tests.support.rigs import free_ports

ROUTER = program("router", "")
TOOL = program("supervisor", "")


@contextmanager
def router(credentials: Credentials | None) -> Generator[str]:
    """Start a router with these credentials, or a plain one; yields its endpoint, for the same
    protocol."""
    port = free_ports(1)
    ends = router_session("127.0.0.1", port)
    if credentials is not None:
        ends = secured(ends, TlsIdentity(credentials, {}))
    with open_session(ends, "router"):
        yield ends.listen[0]


@pytest.fixture(scope="module")
def place(folder: Folder) -> Generator[str]:
    with router(folder.credentials(ROUTER)) as listening:
        yield listening


def test_a_working_link_gives_an_empty_diagnosis(place: str, folder: Folder) -> None:
    assert diagnose_link(place, folder.credentials(TOOL), "router") == ""


def test_a_port_without_a_listener_is_reported(folder: Folder) -> None:
    wanted = endpoint("127.0.0.1", free_ports(1), "router")
    for credentials in (None, folder.credentials(TOOL)):
        assert diagnose_link(wanted, credentials) == f"no program listens at {wanted}"


def test_a_plain_connection_to_a_tls_port_is_reported(place: str) -> None:
    assert "speaks TLS: set the folder of certificates" in diagnose_link(place, None)


def test_a_tls_connection_to_a_plain_port_is_reported(folder: Folder) -> None:
    with router(None) as plain:
        assert diagnose_link(plain, None) == ""
        diagnosis = diagnose_link(plain, folder.credentials(TOOL))
    assert "does not speak TLS" in diagnosis


def test_a_router_of_another_authority_is_diagnosed(
    place: str, tmp_path: Path, folder: Folder
) -> None:
    other = folder_for(tmp_path / "other", "demo")
    assert "not trusted here" in diagnose_link(place, other.credentials(TOOL))
    # The client trusts the router, but the router does not trust the client.
    shutil.copy(folder.path / "authority.crt", other.path / "authority.crt")
    diagnosis = diagnose_link(place, other.credentials(TOOL))
    assert "trusts another authority" in diagnosis
    assert str(other.path / "supervisor.crt") in diagnosis


def test_an_expired_certificate_is_reported(place: str, tmp_path: Path, folder: Folder) -> None:
    copy = Folder(tmp_path / "copy")
    shutil.copytree(folder.path, copy.path)
    copy.renew(TOOL, NOW - timedelta(days=10), 1.0)
    assert "has expired" in diagnose_link(place, copy.credentials(TOOL))
    copy.renew(ROUTER, NOW - timedelta(days=10), 1.0)
    with router(copy.credentials(ROUTER)) as ended:
        diagnosis = diagnose_link(ended, folder.credentials(TOOL))
    assert "not trusted here: certificate has expired" in diagnosis


def test_a_certificate_for_another_host_is_reported(tmp_path: Path) -> None:
    elsewhere = Folder(tmp_path / "elsewhere")
    establish(elsewhere, ["demo"], ["bench"], NOW)
    with router(elsewhere.credentials(ROUTER)) as listening:
        diagnosis = diagnose_link(listening, elsewhere.credentials(TOOL))
    assert "IP address mismatch" in diagnosis


def test_a_certificate_of_another_program_is_reported(place: str, folder: Folder) -> None:
    diagnosis = diagnose_link(place, folder.credentials(TOOL), "demo/actuator")
    assert diagnosis == f"{place} sent the certificate of router, not that of demo/actuator"


def test_a_session_that_cannot_be_opened_reports_the_same_reason(
    place: str, tmp_path: Path
) -> None:
    other = folder_for(tmp_path / "other", "demo")
    port = int(place.rpartition(":")[2])
    ends = client_session("127.0.0.1", port)
    with pytest.raises(BusError, match="speaks TLS"):
        open_session(ends, "plain")
    with pytest.raises(BusError, match="not trusted here"):
        open_session(secured(ends, TlsIdentity(other.credentials(TOOL), {})), "stranger")
