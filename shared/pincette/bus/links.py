"""Who listens where, and who connects to whom: derived from the topics, kept in no second list.

The services of one rig are peers with one direct link wherever one consumes what the other
produces; each also has a link to the router, which serves the supervisor, the recorder and other
tools. Nothing listens beyond the host the rig file names, and nothing is found by multicast.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from pincette.security.access import Access
from pincette.security.identity import Credentials
from pincette.service import Participant, services_of
from pincette.topics import LOOP, Topic

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
    """Where a program listens: the router at ``port``, the services of the loop after it.

    One that composes several services listens at the place of each; this is the first.
    """
    offset = 0 if program == "router" else 1 + LOOP.index(services_of(program)[0])
    return f"{PLAIN}{host}:{port + offset}"


def address_of(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint; see ``endpoint``."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host.strip("[]"), int(port)


def router_ends(
    host: str, port: int, *, lockstep: bool = False, upstream: tuple[str, int] | None = None
) -> Ends:
    """A router's place; with ``upstream`` it connects to another router, whenever that is there."""
    above = () if upstream is None else (endpoint(*upstream, "router"),)
    return Ends("router", (endpoint(host, port, "router"),), above, patient=lockstep)


def client_ends(host: str, port: int, *, lockstep: bool = False) -> Ends:
    """A tool's place: everything goes through the router."""
    return Ends("client", connect=(endpoint(host, port, "router"),), patient=lockstep)


def direct_ends(host: str, port: int, program: str) -> Ends:
    """A tool's place beside the router, straight to one service."""
    return Ends("client", connect=(endpoint(host, port, program),))


def producers(service: Participant, *, lockstep: bool) -> set[str]:
    """Services whose samples a program takes; a pace is taken in lockstep only."""
    return {item.topic.producer for item in service.inputs if item.role != "pace" or lockstep}


def consumers(name: str, services: Mapping[str, Participant], *, lockstep: bool) -> set[str]:
    """Programs that take what a program produces."""
    own = services_of(name)
    return {
        other
        for other, service in services.items()
        if not producers(service, lockstep=lockstep).isdisjoint(own)
    }


def partners(name: str, services: Mapping[str, Participant], *, lockstep: bool) -> set[str]:
    """Programs with which a program has a direct link."""
    taken = producers(services[name], lockstep=lockstep)
    given = consumers(name, services, lockstep=lockstep)
    return given | {other for other in services if not taken.isdisjoint(services_of(other))}


def awaited(name: str, services: Mapping[str, Participant], *, lockstep: bool) -> frozenset[Topic]:
    """Topics of a program that services of the loop in other programs take."""
    own = services_of(name)
    return frozenset(
        item.topic
        for service in services.values()
        for item in service.inputs
        if item.topic.producer in own and (item.role != "pace" or lockstep)
    )


def peer_ends(
    host: str,
    port: int,
    name: str,
    services: Mapping[str, Participant],
    *,
    lockstep: bool,
    router_at: tuple[str, int] | None = None,
) -> Ends:
    """The place of a program of the loop: it listens, and connects to the partners before it.

    The router is ``router_at``, or at ``host`` and ``port`` where that is None.
    """
    own = services_of(name)
    linked = partners(name, services, lockstep=lockstep)
    before = [other for other in linked if _place(other) < _place(name)]
    return Ends(
        "peer",
        tuple(endpoint(host, port, service) for service in own),
        (
            endpoint(*(router_at or (host, port)), "router"),
            *(endpoint(host, port, other) for other in sorted(before, key=_place)),
        ),
        patient=lockstep,
    )


def _place(program: str) -> int:
    """Where a program's first service is in a tick."""
    return LOOP.index(services_of(program)[0])
