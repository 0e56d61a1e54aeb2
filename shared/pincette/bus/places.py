"""Where the programs of a rig file join the bus: over mutual TLS where it names certificates.

Each place raises SecurityError where its certificate is missing, or not in order.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

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
from pincette.bus.protocol import BusError
from pincette.config import RigFile
from pincette.security.access import (
    Access,
    beyond_rig,
    beyond_upstream,
    client_access,
    neighbour_access,
    router_access,
    service_access,
)
from pincette.security.identity import OPERATOR, ROUTER, UPSTREAM, Identity, program
from pincette.service import Participant

if TYPE_CHECKING:
    from pincette.security.folder import Folder

THE_ROUTER, THE_UPSTREAM = program(ROUTER, ""), program(UPSTREAM, "")


def router_place(rig: RigFile) -> Ends:
    """The router's place."""
    bus = rig.bus
    host = bus.listen or bus.host
    ends = router_ends(host, bus.port, lockstep=rig.lockstep, upstream=bus.upstream_at)
    folder = _folder(rig)
    if folder is None:
        return ends
    known = [facts.identity for facts in folder.all()]
    beyond = beyond_upstream(known, rig.rig.name, apart=bus.apart)
    none: Access = {}
    above = none if bus.upstream is None else neighbour_access(THE_UPSTREAM, beyond)
    access = {**router_access(known), **above}
    return _joined(ends, folder, THE_ROUTER, access)


def upstream_place(rig: RigFile) -> Ends:
    """The place of a laboratory server's router, which that of a rig connects to.

    Raises
    ------
    BusError
        Where the rig file names none.
    """
    bus = rig.bus
    if bus.upstream_at is None:
        raise BusError(f"rig {rig.rig.name!r} has no [bus] upstream: HOST:PORT of this router")
    ends = router_ends(*bus.upstream_at, lockstep=rig.lockstep)
    folder = _folder(rig)
    if folder is None:
        return ends
    known = [facts.identity for facts in folder.all()]
    below = beyond_rig(known, rig.rig.name, apart=bus.apart)
    access = {**router_access(known), **neighbour_access(THE_ROUTER, below)}
    return _joined(ends, folder, THE_UPSTREAM, access)


def service_place(rig: RigFile, name: str, services: Mapping[str, Participant]) -> Ends:
    """The place of a program of the loop, which has an access list of its own."""
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
        rig, client_ends(*rig.bus.served_by, lockstep=lockstep), program(name, rig.rig.name)
    )


def tool_place(rig: RigFile) -> Ends:
    """The place of a person's tool, at the router."""
    return _client(rig, client_ends(*rig.bus.served_by))


def tool_place_beside(rig: RigFile, service: str) -> Ends:
    """The place of a person's tool beside the router, straight at one service."""
    ends = direct_ends(rig.bus.host, rig.bus.port, service)
    return _client(rig, ends, server=program(rig.program_of(service), rig.rig.name))


def _client(
    rig: RigFile,
    ends: Ends,
    identity: Identity | None = None,
    server: Identity | None = None,
) -> Ends:
    folder = _folder(rig)
    if folder is None:
        return ends
    who = identity or folder.named(rig.bus.identity)
    beside = THE_UPSTREAM if rig.bus.apart else THE_ROUTER
    return _joined(ends, folder, who, client_access(server or beside))


def _joined(ends: Ends, folder: "Folder", identity: Identity, access: Access) -> Ends:
    from pincette.security.credentials import checked

    credentials = folder.credentials(identity)
    checked(credentials, datetime.now(UTC))
    return secured(ends, Member(credentials, access))


def _folder(rig: RigFile) -> "Folder | None":
    if rig.bus.pki is None:
        return None
    # What reads certificates is loaded where there are any: it is a tenth of a program's start.
    from pincette.security.folder import Folder

    return Folder(Path(rig.bus.pki))
