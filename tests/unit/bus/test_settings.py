"""Zenoh's settings: only explicit links, no discovery, and only TLS if it is required."""

from pathlib import Path

import pytest

from pincette.bus.endpoints import (
    program_endpoint,
    router_endpoint,
    service_endpoint,
    tool_endpoint,
)
from pincette.bus.settings import settings
from pincette.bus.topology import (
    SessionConfig,
    TlsIdentity,
    address_of,
    client_session,
    router_session,
    secured,
)
from pincette.config import RigFile
from pincette.core.topics import LOOP
from pincette.engine.process import loop_services
from pincette.security.access import client_access
from pincette.security.identity import Credentials, SecurityError, program
from tests.support.certificates import folder_for
from tests.support.rigs import demo_rig

ROUTER = program("router", "")
FILES = Credentials(ROUTER, Path("a.crt"), Path("r.crt"), Path("r.key"))
MEMBER = TlsIdentity(FILES, client_access(ROUTER))
PLACES = (router_session("127.0.0.1", 7000), client_session("127.0.0.1", 7000))


@pytest.mark.parametrize("ends", [*PLACES, *(secured(ends, MEMBER) for ends in PLACES)])
def test_multicast_and_gossip_are_off(ends: SessionConfig) -> None:
    scouting = settings(ends, "one")["scouting"]
    assert scouting["multicast"] == scouting["gossip"] == {"enabled": False}


def test_with_certificates_only_tls_is_used_with_a_deny_list() -> None:
    for ends in (secured(one, MEMBER) for one in PLACES):
        tree = settings(ends, "one")
        link = tree["transport"]["link"]
        assert link["protocols"] == ["tls"]
        assert link["tls"]["enable_mtls"] is True
        assert tree["access_control"]["default_permission"] == "deny"
        places = [*tree["listen"]["endpoints"], *tree["connect"]["endpoints"]]
        assert places == ["tls/127.0.0.1:7000"]
        assert address_of(places[0]) == ("127.0.0.1", 7000)


def test_without_certificates_there_is_no_tls_and_no_access_list() -> None:
    for ends in PLACES:
        tree = settings(ends, "one")
        assert "access_control" not in tree
        assert "tls" not in tree["transport"]["link"]


def test_only_the_router_ends_a_link_whose_certificate_expires() -> None:
    ends = {
        ends.mode: settings(secured(ends, MEMBER), "one")["transport"]["link"]["tls"]
        for ends in PLACES
    }
    assert ends["router"]["close_link_on_expiration"] is True
    assert ends["client"]["close_link_on_expiration"] is False


def all_places(rig: RigFile) -> dict[str, SessionConfig]:
    services = loop_services()
    return {
        "router": router_endpoint(rig),
        **{name: service_endpoint(rig, name, services) for name in LOOP},
        **{
            name: program_endpoint(rig, name, lockstep=False) for name in ("supervisor", "recorder")
        },
        "operator": tool_endpoint(rig),
    }


def test_every_port_of_a_rig_uses_tls_if_its_file_names_certificates(tmp_path: Path) -> None:
    rig = demo_rig()
    assert all(ends.tls is None for ends in all_places(rig).values())
    closed = all_places(rig.secured(folder_for(tmp_path / "pki", "demo").path))
    for name, ends in closed.items():
        assert ends.tls is not None
        assert ends.tls.credentials.identity.role == name
        assert all(place.startswith("tls/") for place in (*ends.listen, *ends.connect))


def test_a_program_of_an_extra_uses_the_certificate_of_a_person(tmp_path: Path) -> None:
    rig = demo_rig().secured(folder_for(tmp_path / "pki", "demo").path)
    ends = program_endpoint(rig, "foxglove", lockstep=False)
    assert ends.tls is not None
    assert ends.tls.credentials.identity.name == rig.bus.identity


def test_a_rig_without_certificates_of_its_own_is_refused_with_the_file_name(
    tmp_path: Path,
) -> None:
    rig = demo_rig().secured(folder_for(tmp_path / "pki", "left").path)
    with pytest.raises(SecurityError, match=r"demo/sensor\.crt: No such file"):
        service_endpoint(rig, "sensor", loop_services())
