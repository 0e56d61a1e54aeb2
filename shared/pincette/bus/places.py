"""Where the programs of a rig file join the bus: over mutual TLS where it names certificates.

Each place raises SecurityError where its certificate is missing, or not in order.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from pincette.bus.links import (
    Ends,
    Member,
    client_ends,
    direct_ends,
    partners,
    peer_ends,
    router_ends,
    secured,
)
from pincette.config import RigFile
from pincette.security.access import Access, client_access, router_access, service_access
from pincette.security.credentials import checked
from pincette.security.folder import Folder
from pincette.security.identity import OPERATOR, ROUTER, Identity, program
from pincette.service import AnyService

THE_ROUTER = program(ROUTER, "")


def router_place(rig: RigFile) -> Ends:
    """The router's place."""
    ends = router_ends(rig.bus.host, rig.bus.port, lockstep=rig.lockstep)
    folder = _folder(rig)
    if folder is None:
        return ends
    known = (facts.identity for facts in folder.all())
    return _joined(ends, folder, THE_ROUTER, router_access(known))


def service_place(rig: RigFile, name: str, services: Mapping[str, AnyService]) -> Ends:
    """The place of a service of the loop, which has an access list of its own."""
    bus, lockstep = rig.bus, rig.lockstep
    ends = peer_ends(bus.host, bus.port, name, services, lockstep=lockstep, router_at=bus.router_at)
    folder = _folder(rig)
    if folder is None:
        return ends
    linked = {other: services[other] for other in partners(name, services, lockstep=lockstep)}
    operators = [one.identity.name for one in folder.all() if one.identity.role == OPERATOR]
    access = service_access(services[name], rig.rig.name, linked, operators)
    return _joined(ends, folder, program(name, rig.rig.name), access)


def program_place(rig: RigFile, name: str, *, lockstep: bool) -> Ends:
    """The place of a program outside the loop, at the router."""
    return _client(
        rig, client_ends(*rig.bus.router_at, lockstep=lockstep), program(name, rig.rig.name)
    )


def tool_place(rig: RigFile) -> Ends:
    """The place of a person's tool, at the router."""
    return _client(rig, client_ends(*rig.bus.router_at))


def tool_place_beside(rig: RigFile, service: str) -> Ends:
    """The place of a person's tool beside the router, straight at one service."""
    ends = direct_ends(rig.bus.host, rig.bus.port, service)
    return _client(rig, ends, server=program(service, rig.rig.name))


def _client(
    rig: RigFile,
    ends: Ends,
    identity: Identity | None = None,
    server: Identity = THE_ROUTER,
) -> Ends:
    folder = _folder(rig)
    if folder is None:
        return ends
    who = identity or folder.named(rig.bus.identity)
    return _joined(ends, folder, who, client_access(server))


def _joined(ends: Ends, folder: Folder, identity: Identity, access: Access) -> Ends:
    credentials = folder.credentials(identity)
    checked(credentials, datetime.now(UTC))
    return secured(ends, Member(credentials, access))


def _folder(rig: RigFile) -> Folder | None:
    return None if rig.bus.pki is None else Folder(Path(rig.bus.pki))
