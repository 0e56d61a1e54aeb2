"""A router behind its guard, in this process, and how a client joins it."""

from dataclasses import replace
from time import monotonic

from pincette.bus.guard import Guard
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
from pincette.security.identity import program
from tests.support.rigs import free_ports

ROUTER, TOOL = program("router", ""), program("supervisor", "")
OPENS_S = 1.0
"""In which a link is made while strangers come; without the guard it took 40 s."""


def joining(port: int, folder: Folder | None) -> SessionConfig:
    """Return how a client joins the router at a port."""
    plain = client_session("127.0.0.1", port)
    near = replace(plain, near=plain.connect)
    if folder is None:
        return near
    return secured(near, TlsIdentity(folder.credentials(TOOL), client_access(ROUTER)))


class Door:
    """A router behind its guard, and how a client joins it."""

    def __init__(self, folder: Folder | None) -> None:
        self.port = free_ports(1)
        listens = router_session("127.0.0.1", self.port)
        if folder is not None:
            known = router_access([ROUTER, TOOL])
            listens = secured(listens, TlsIdentity(folder.credentials(ROUTER), known))
        self.client = joining(self.port, folder)
        self.router: Joined = open_session(listens, "router")
        assert self.router.guard is not None
        self.guard: Guard = self.router.guard

    def opened_s(self) -> float:
        """How long it takes to join."""
        begun_s = monotonic()
        with open_session(self.client, "tool"):
            return monotonic() - begun_s
