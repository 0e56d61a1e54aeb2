"""Endpoints of a rig file's programs, with mutual TLS by their certificates; they raise
SecurityError.
"""

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from pincette.bus.protocol import BusError
from pincette.bus.topology import (
    SessionConfig,
    TlsIdentity,
    client_session,
    direct_session,
    partners,
    peer_session,
    router_session,
    secured,
)
from pincette.core.service import Participant
from pincette.security.access import (
    Access,
    beyond_rig,
    beyond_upstream,
    client_access,
    neighbour_access,
    router_access,
    service_access,
)
from pincette.security.identity import (
    OF_A_RIG,
    OPERATOR,
    ROUTER,
    SHARED,
    UPSTREAM,
    Identity,
    program,
)

if TYPE_CHECKING:
    from pincette.config import RigFile
    from pincette.config.stop_file import StopFile
    from pincette.security.folder import Folder

LATE_ROUTER_S = 20.0
"""Time limit for a simulated rig to join the bus, in s. `pincette up` starts it together with the
router, and the router's start takes longer on a busy machine, especially with certificates.
"""
THE_ROUTER, THE_UPSTREAM = program(ROUTER, ""), program(UPSTREAM, "")


def router_endpoint(rig: "RigFile") -> SessionConfig:
    """Return the endpoint of the router."""
    bus = rig.bus
    host = bus.listen or bus.host
    config = router_session(host, bus.port, lockstep=rig.lockstep, upstream=bus.upstream_at)
    folder = _folder(rig)
    if folder is None:
        return config
    known = [facts.identity for facts in folder.all()]
    beyond = beyond_upstream(known, rig.rig.name, served_upstream=bus.served_upstream)
    none: Access = {}
    above = none if bus.upstream is None else neighbour_access(THE_UPSTREAM, beyond)
    access = {**router_access(known), **above}
    return _joined(config, folder, THE_ROUTER, access)


def upstream_endpoint(rig: "RigFile") -> SessionConfig:
    """Return the endpoint of a laboratory server's router.

    Raises BusError if the rig file has none.
    """
    bus = rig.bus
    if bus.upstream_at is None:
        raise BusError(f"rig {rig.rig.name!r} has no [bus] upstream: HOST:PORT of this router")
    config = router_session(*bus.upstream_at, lockstep=rig.lockstep)
    folder = _folder(rig)
    if folder is None:
        return config
    known = [facts.identity for facts in folder.all()]
    below = beyond_rig(known, rig.rig.name, served_upstream=bus.served_upstream)
    access = {**router_access(known), **neighbour_access(THE_ROUTER, below)}
    return _joined(config, folder, THE_UPSTREAM, access)


def service_endpoint(
    rig: "RigFile", name: str, services: Mapping[str, Participant]
) -> SessionConfig:
    """Return the endpoint of a program of the loop, which has its own access list."""
    bus, lockstep = rig.bus, rig.lockstep
    config = peer_session(
        bus.host, bus.port, name, services, lockstep=lockstep, router_at=bus.router_at
    )
    folder = _folder(rig)
    if folder is None:
        return config
    linked = {other: services[other] for other in partners(name, services, lockstep=lockstep)}
    operators = [one.identity.name for one in folder.all() if one.identity.role == OPERATOR]
    access = service_access(services[name], rig.rig.name, linked, operators)
    return _joined(config, folder, program(name, rig.rig.name), access)


def program_endpoint(rig: "RigFile", name: str, *, lockstep: bool) -> SessionConfig:
    """Return the endpoint of a program outside the loop, connected to the router.

    A program of an optional package has no certificate of its own. Like a tool, it presents the
    certificate of ``[bus] identity``.
    """
    config = client_session(*rig.bus.served_by, lockstep=lockstep)
    if name == "rig":
        config = replace(config, connect_s=LATE_ROUTER_S)
    own = name in (*SHARED, *OF_A_RIG)
    return _client(rig, config, program(name, rig.rig.name) if own else None)


def tool_endpoint(rig: "RigFile | StopFile") -> SessionConfig:
    """Return the endpoint of a person's tool, connected to the router."""
    return _client(rig, client_session(*rig.bus.served_by))


def direct_endpoint(
    rig: "RigFile | StopFile", service: str, identity: Identity | None = None
) -> SessionConfig:
    """Return the endpoint of a client that connects to one service without the router.

    ``identity``: name of the certificate that the client presents; None: that of a person's tool.
    """
    config = direct_session(rig.bus.host, rig.bus.port, service)
    return _client(rig, config, identity, program(rig.program_of(service), rig.rig.name))


def _client(
    rig: "RigFile | StopFile",
    config: SessionConfig,
    identity: Identity | None = None,
    server: Identity | None = None,
) -> SessionConfig:
    folder = _folder(rig)
    if folder is None:
        return config
    router = THE_UPSTREAM if rig.bus.served_upstream else THE_ROUTER
    identity = identity or folder.named(rig.bus.identity)
    return _joined(config, folder, identity, client_access(server or router))


def _joined(
    config: SessionConfig, folder: "Folder", identity: Identity, access: Access
) -> SessionConfig:
    from pincette.security.folder import checked

    credentials = folder.credentials(identity)
    checked(credentials, datetime.now(UTC))
    return secured(config, TlsIdentity(credentials, access))


def _folder(rig: "RigFile | StopFile") -> "Folder | None":
    if rig.bus.pki is None:
        return None
    # Imported only if there are certificates: the import takes a tenth of a program's start time.
    from pincette.security.folder import Folder

    return Folder(Path(rig.bus.pki))
