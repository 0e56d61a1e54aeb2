"""Identities on the bus, by the names of their certificates; access follows from their roles."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pincette.core.service import member_services
from pincette.core.topics import LOOP

ROUTER, UPSTREAM, SUPERVISOR = "router", "upstream", "supervisor"
ROUTERS = (ROUTER, UPSTREAM)
"""Names of the router of a rig, and of the router of a laboratory server, to which the rig's router
connects.
"""
SHARED = (*ROUTERS, SUPERVISOR)
"""Programs that all rigs on one router share."""
OF_A_RIG = (*LOOP, "recorder", "rig")
"""Programs of which each rig has its own."""
VIEWER, OPERATOR = "viewer", "operator"
PEOPLE = (VIEWER, OPERATOR)
"""Roles of people and their tools: one may only read everything, the other may also stop."""
AUTHORITY = "authority"
NAME = re.compile(r"[a-z][a-z0-9-]{0,30}")
"""Pattern of the name of a rig or a person."""


class SecurityError(Exception):
    """Error for certificates that cannot be created, read or used; the text gives the remedy."""


@dataclass(frozen=True, slots=True)
class Identity:
    """A program or a person."""

    name: str
    """Common name of the certificate, and path of its file: ``viewer``, ``demo/controller``."""
    role: str

    @property
    def rig(self) -> str:
        """Name of the rig whose program this is; empty for identities that belong to no rig."""
        return self.name.partition("/")[0] if "/" in self.name else ""

    @property
    def serves(self) -> bool:
        """True if others connect to this identity, on the bus or over REST."""
        return self.role in SHARED or bool(member_services(self.role))


@dataclass(frozen=True, slots=True)
class Credentials:
    """Files of one identity, and of the authority that it trusts."""

    identity: Identity
    authority: Path
    certificate: Path
    private_key: Path


def program(name: str, rig: str) -> Identity:
    """Return a program, one of the rig's own or one that all rigs share."""
    return Identity(name if name in SHARED else f"{rig}/{name}", name)


def programs_of(rig: str, composed: Iterable[str] = ()) -> tuple[Identity, ...]:
    """Return all programs of a rig, also those that compose services of its loop.

    Raises SecurityError.
    """
    _checked(rig, "rig")
    return tuple(program(name, rig) for name in (*OF_A_RIG, *composed))


def person(name: str, role: str) -> Identity:
    """Return a person or a person's tool; raises SecurityError for an invalid name or role."""
    if role not in PEOPLE:
        raise SecurityError(f"role {role!r}: expected {' or '.join(PEOPLE)}")
    _checked(name, "person")
    return Identity(name, role)


def _checked(name: str, whose: str) -> None:
    if not NAME.fullmatch(name) or name in (*SHARED, AUTHORITY):
        raise SecurityError(
            f"{name!r} cannot be the name of a {whose}: give a letter, then at most 30 "
            "letters, digits or hyphens, all lower case, and not "
            f"{', '.join((*SHARED, AUTHORITY))}"
        )
