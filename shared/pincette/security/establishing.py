"""Initial identities of a folder of certificates, and those that are added later."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime

from pincette.core.files import replace_file
from pincette.security.folder import SOON, Folder
from pincette.security.identity import (
    OPERATOR,
    ROUTER,
    SUPERVISOR,
    UPSTREAM,
    VIEWER,
    Identity,
    person,
    program,
    programs_of,
)

AUTHORITY_DAYS, DAYS = 3650.0, 730.0
"""Validity of the authority and of a certificate, in days."""
LOOPBACK = ("127.0.0.1", "localhost")
README = "README.txt"
EXPLAINED = """\
Certificates of pincette, made by `pincette security`. FILE.crt is public, FILE.key is secret.

authority.crt     whom every program believes; each machine needs a copy
authority.key     makes further certificates, and whoever has it is let in everywhere: no program
                  reads it, so take it away to a safe place and bring it back to add, issue, renew
router.*          the router
upstream.*        the router of a laboratory server, where there is one
supervisor.*      the supervisor
RIG/PROGRAM.*     the programs of a rig
viewer.*          for tools that look on: reads all, writes nothing
operator.*        for tools that may also trip a rig, and operate a simulated one
revoked           certificates that were withdrawn; each machine needs a copy

The router lets in whom it finds here when it starts, so it needs every .crt, and the actuator
those of the operators; a program needs authority.crt, its own .crt and its own .key, and revoked
where others connect to it.
"""


def establish(
    folder: Folder,
    rigs: Sequence[str],
    hosts: Sequence[str],
    now: datetime,
    days: float = DAYS,
    composed: Sequence[str] = (),
) -> None:
    """Create a folder for the programs of rigs, a viewer and an operator; raises SecurityError."""
    wanted = [
        program(ROUTER, ""),
        program(SUPERVISOR, ""),
        *(one for rig in rigs for one in programs_of(rig, composed)),
        person(VIEWER, VIEWER),
        person(OPERATOR, OPERATOR),
    ]
    folder.begin(now, max(days, AUTHORITY_DAYS))
    replace_file(folder.path / README, EXPLAINED.encode())
    _issue(folder, wanted, hosts, now, days)


def enrol(
    folder: Folder,
    rig: str,
    hosts: Sequence[str],
    now: datetime,
    days: float = DAYS,
    composed: Sequence[str] = (),
) -> tuple[Identity, ...]:
    """Add the programs of a rig, or the composed programs of a known one; raises SecurityError."""
    wanted = programs_of(rig, composed)
    if composed and rig in folder.rigs():
        wanted = tuple(one for one in wanted if one.role in composed)
    _issue(folder, wanted, hosts, now, days)
    return wanted


def enrol_upstream(
    folder: Folder, hosts: Sequence[str], now: datetime, days: float = DAYS
) -> Identity:
    """Add the router of a laboratory server with its hosts; raises SecurityError."""
    identity = program(UPSTREAM, "")
    _issue(folder, [identity], hosts, now, days)
    return identity


def due(folder: Folder, now: datetime) -> Iterator[Identity]:
    """Return the identities whose certificates end soon, or have ended."""
    return (facts.identity for facts in folder.all() if facts.ends - now < SOON)


def _issue(
    folder: Folder, wanted: Iterable[Identity], hosts: Sequence[str], now: datetime, days: float
) -> None:
    for identity in wanted:
        folder.issue(identity, hosts or LOOPBACK, now, days)
