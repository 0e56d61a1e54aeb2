"""The links between programs, derived from the topics; multicast is not used."""

# The services of one rig are peers. Two of them have a direct link if one consumes what the other
# produces. Each also has a link to the router, which serves the supervisor, the recorder and other
# tools. Programs listen only at the host that the rig file names.

from collections.abc import Mapping
from dataclasses import dataclass, replace

from pincette.core.service import Participant, member_services
from pincette.core.topics import LOOP, Topic
from pincette.security.access import Access
from pincette.security.identity import Credentials

PLAIN, SECURE = "tcp/", "tls/"


@dataclass(frozen=True, slots=True)
class TlsIdentity:
    """Certificate of a program, and the permissions that it grants to other programs."""

    credentials: Credentials
    access: Access


@dataclass(frozen=True, slots=True)
class SessionConfig:
    """Settings with which one program joins the bus."""

    mode: str
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    patient: bool = False
    """True in lockstep: wait for a stalled link, so that no sample is lost on it."""
    tls: TlsIdentity | None = None
    """Certificates of the links; None: links are neither encrypted nor access-controlled."""
    connect_s: float = 3.0
    """Time limit for a client to join, in s."""


def secured(config: SessionConfig, member: TlsIdentity) -> SessionConfig:
    """Return the same session with mutual TLS on every link."""
    listen, connect = (
        tuple(SECURE + one.removeprefix(PLAIN) for one in places)
        for places in (config.listen, config.connect)
    )
    return replace(config, listen=listen, connect=connect, tls=member)


def endpoint(host: str, port: int, program: str) -> str:
    """Return the endpoint of a program: the router at ``port``, each service at its own port."""
    offset = 0 if program == "router" else 1 + LOOP.index(member_services(program)[0])
    return f"{PLAIN}{host}:{port + offset}"


def address_of(endpoint: str) -> tuple[str, int]:
    """Return host and port of an endpoint; see ``endpoint``."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host.strip("[]"), int(port)


def router_session(
    host: str, port: int, *, lockstep: bool = False, upstream: tuple[str, int] | None = None
) -> SessionConfig:
    """Return the session of a router. It connects to an upstream router whenever one runs."""
    above = () if upstream is None else (endpoint(*upstream, "router"),)
    return SessionConfig("router", (endpoint(host, port, "router"),), above, patient=lockstep)


def client_session(host: str, port: int, *, lockstep: bool = False) -> SessionConfig:
    """Return the session of a tool that connects through the router."""
    return SessionConfig("client", connect=(endpoint(host, port, "router"),), patient=lockstep)


def direct_session(host: str, port: int, program: str) -> SessionConfig:
    """Return the session of a tool that connects to one service, without the router."""
    return SessionConfig("client", connect=(endpoint(host, port, program),))


def producers(service: Participant, *, lockstep: bool) -> set[str]:
    """Return the services whose samples a program receives; in lockstep also those that determine
    its pace.
    """
    return {item.topic.producer for item in service.inputs if item.role != "pace" or lockstep}


def consumers(name: str, services: Mapping[str, Participant], *, lockstep: bool) -> set[str]:
    """Return the programs that receive the samples of a program."""
    own = member_services(name)
    return {
        other
        for other, service in services.items()
        if not producers(service, lockstep=lockstep).isdisjoint(own)
    }


def partners(name: str, services: Mapping[str, Participant], *, lockstep: bool) -> set[str]:
    """Return the programs with which a program has a direct link."""
    taken = producers(services[name], lockstep=lockstep)
    given = consumers(name, services, lockstep=lockstep)
    return given | {other for other in services if not taken.isdisjoint(member_services(other))}


def awaited(name: str, services: Mapping[str, Participant], *, lockstep: bool) -> frozenset[Topic]:
    """Return the topics of a program that loop services in other programs receive."""
    own = member_services(name)
    return frozenset(
        item.topic
        for service in services.values()
        for item in service.inputs
        if item.topic.producer in own and (item.role != "pace" or lockstep)
    )


def peer_session(
    host: str,
    port: int,
    name: str,
    services: Mapping[str, Participant],
    *,
    lockstep: bool,
    router_at: tuple[str, int] | None = None,
) -> SessionConfig:
    """Return the session of a loop program: it listens, and connects to partners earlier in the
    tick.
    """
    own = member_services(name)
    linked = partners(name, services, lockstep=lockstep)
    before = sorted((other for other in linked if _place(other) < _place(name)), key=_place)
    partners_at = tuple(endpoint(host, port, other) for other in before)
    router = endpoint(*(router_at or (host, port)), "router")
    return SessionConfig(
        "peer",
        tuple(endpoint(host, port, service) for service in own),
        (router, *partners_at),
        patient=lockstep,
    )


def _place(program: str) -> int:
    """Return the position, in the order of a tick, of a program's first service."""
    return LOOP.index(member_services(program)[0])
