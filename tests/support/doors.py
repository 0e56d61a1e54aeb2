"""A router in this process, plain or with TLS, and clients that join it."""

from time import monotonic

from pincette.bus.session import Joined, open_session
from pincette.bus.topology import (
    SessionConfig,
    TlsIdentity,
    client_session,
    router_session,
    secured,
)
from pincette.security.access import client_access, router_access
from pincette.security.folder import Folder
from pincette.security.identity import Identity, program
from tests.support.rigs import free_ports

ROUTER, TOOL = program("router", ""), program("supervisor", "")
OPENS_S = 1.0
"""Limit of the time to join while unknown clients connect; Zenoh's defaults take up to 40 s."""


def joining(port: int, folder: Folder | None, own: Identity = TOOL) -> SessionConfig:
    """Return the configuration with which a client joins the router at a port, with TLS as
    ``own``."""
    plain = client_session("127.0.0.1", port)
    if folder is None:
        return plain
    return secured(plain, TlsIdentity(folder.credentials(own), client_access(ROUTER)))


class Door:
    """A router, and the configuration with which a client joins it."""

    def __init__(self, folder: Folder | None) -> None:
        self.port = free_ports(1)
        listens = router_session("127.0.0.1", self.port)
        if folder is not None:
            known = router_access([ROUTER, TOOL])
            listens = secured(listens, TlsIdentity(folder.credentials(ROUTER), known))
        self.listens = listens
        self.client = joining(self.port, folder)
        self.router: Joined = open_session(listens, "router")

    def opened_s(self) -> float:
        """Return the time that a client takes to join, in s."""
        begun_s = monotonic()
        with open_session(self.client, "tool"):
            return monotonic() - begun_s
