"""Who listens where, and who connects to whom: derived from the topics, kept in no second list.

The services of one rig are peers with one direct link wherever one consumes what the other
produces; each also has a link to the router, which serves the supervisor, the recorder and other
tools. Nothing listens beyond the host the rig file names, and nothing is found by multicast.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from pincette.security.access import Access
from pincette.security.credentials import Credentials
from pincette.service import AnyService
from pincette.topics import LOOP

PLAIN, SECURE = "tcp/", "tls/"


@dataclass(frozen=True, slots=True)
class Member:
    """What a program proves itself with, and what it lets others do."""

    credentials: Credentials
    access: Access


@dataclass(frozen=True, slots=True)
class Ends:
    """How one program joins the bus."""

    mode: str
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    patient: bool = False
    """In lockstep: a link that stalls is waited for, so that no sample is lost on it."""
    member: Member | None = None
    """None: the links are neither encrypted nor closed to anybody."""


def secured(ends: Ends, member: Member) -> Ends:
    """The same place with mutual TLS on every link."""
    listen, connect = (
        tuple(SECURE + one.removeprefix(PLAIN) for one in places)
        for places in (ends.listen, ends.connect)
    )
    return replace(ends, listen=listen, connect=connect, member=member)


def endpoint(host: str, port: int, program: str) -> str:
    """Where a program listens: the router at ``port``, the services of the loop after it."""
    offset = 0 if program == "router" else 1 + LOOP.index(program)
    return f"{PLAIN}{host}:{port + offset}"


def address_of(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint; see ``endpoint``."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host.strip("[]"), int(port)


def router_ends(host: str, port: int, *, lockstep: bool = False) -> Ends:
    """The router's place."""
    return Ends("router", listen=(endpoint(host, port, "router"),), patient=lockstep)


def client_ends(host: str, port: int, *, lockstep: bool = False) -> Ends:
    """A tool's place: everything goes through the router."""
    return Ends("client", connect=(endpoint(host, port, "router"),), patient=lockstep)


def direct_ends(host: str, port: int, program: str) -> Ends:
    """A tool's place beside the router, straight to one service."""
    return Ends("client", connect=(endpoint(host, port, program),))


def producers(service: AnyService, *, lockstep: bool) -> set[str]:
    """Programs whose samples a service takes; a pace is taken in lockstep only."""
    return {item.topic.producer for item in service.inputs if item.role != "pace" or lockstep}


def consumers(name: str, services: Mapping[str, AnyService], *, lockstep: bool) -> set[str]:
    """Services that take what a service produces."""
    return {
        other
        for other, service in services.items()
        if name in producers(service, lockstep=lockstep)
    }


def partners(name: str, services: Mapping[str, AnyService], *, lockstep: bool) -> set[str]:
    """Services with which a service has a direct link."""
    return producers(services[name], lockstep=lockstep) | consumers(
        name, services, lockstep=lockstep
    )


def peer_ends(
    host: str,
    port: int,
    name: str,
    services: Mapping[str, AnyService],
    *,
    lockstep: bool,
    router_at: tuple[str, int] | None = None,
) -> Ends:
    """A service's place: it listens, and connects to the partners that come before it.

    The router is ``router_at``, or at ``host`` and ``port`` where that is None.
    """
    linked = partners(name, services, lockstep=lockstep)
    router = endpoint(*(router_at or (host, port)), "router")
    earlier = [other for other in LOOP[: LOOP.index(name)] if other in linked]
    connect = (router, *(endpoint(host, port, other) for other in earlier))
    return Ends("peer", (endpoint(host, port, name),), connect, patient=lockstep)
