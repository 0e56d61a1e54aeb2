"""Expiry of a certificate while its link is up, in real time."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.bus.session import open_session
from pincette.bus.topology import SessionConfig, TlsIdentity, client_session, endpoint, secured
from pincette.core.topics import COMMAND, key
from pincette.security.access import client_access
from pincette.security.identity import Identity, program
from tests.support.certificates import folder_for
from tests.support.rigs import free_ports

pytestmark = pytest.mark.usefixtures("stalls")

LASTS = timedelta(seconds=4)
AFTER_S = 3.0
"""Time after which the link must be closed; Zenoh checks the expiry of a certificate about once a
second."""
BEAT_S = 0.05
TOOL = program("supervisor", "")


@pytest.mark.parametrize(("mode", "goes_on"), [("router", False), ("peer", True)])
def test_the_router_closes_a_link_whose_certificate_has_expired_and_a_service_does_not(
    tmp_path: Path, mode: str, goes_on: bool
) -> None:
    folder, port = folder_for(tmp_path / "pki", "demo"), free_ports(1)
    server: Identity = program("router" if mode == "router" else "controller", "demo")
    listening = SessionConfig(mode, listen=(endpoint("127.0.0.1", port, "router"),))
    ours = TlsIdentity(folder.credentials(server), client_access(TOOL))
    tool = TlsIdentity(folder.credentials(TOOL), client_access(server))
    heard: list[float] = []
    with open_session(secured(listening, ours), "server") as reported:
        end = datetime.now(UTC) + LASTS
        folder.renew(TOOL, datetime.now(UTC), LASTS / timedelta(days=1))
        with open_session(secured(client_session("127.0.0.1", port), tool), "tool") as hearing:
            hearing.declare_subscriber(key("demo", COMMAND), lambda _: heard.append(monotonic()))
            while datetime.now(UTC) < end + timedelta(seconds=AFTER_S):
                reported.put(key("demo", COMMAND), b"")
                sleep(BEAT_S)
            assert len(heard) > 5
            assert (monotonic() - heard[-1] < AFTER_S / 2) == goes_on
