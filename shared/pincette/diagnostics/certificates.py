"""Validity of the certificates of a rig."""

from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from pincette.config import RigFile
from pincette.diagnostics import Finding, noted
from pincette.security.identity import (
    ROUTER,
    SUPERVISOR,
    UPSTREAM,
    Identity,
    SecurityError,
    program,
)
from pincette.security.revocation import read_revoked

if TYPE_CHECKING:
    from pincette.security.certificates import Facts
    from pincette.security.folder import Folder


def certificates(rig: RigFile, now: datetime | None = None) -> Iterator[Finding]:
    """Yield a finding for each program of a rig: whether its certificate is valid on this machine
    today.

    Only keys on this machine are checked; programs on other machines have their keys there.
    """
    if rig.bus.pki is None:
        key, place = ("listen", rig.bus.listen) if rig.bus.listen else ("host", rig.bus.host)
        if not _loopback(place):
            yield noted(
                f"certificates: none, and [bus] {key} = {place!r} is not on this machine "
                "only: anyone who can reach it can move the arm",
                "`pincette security init FOLDER`, then [bus] pki; docs/how-to/secure.md",
            )
        return
    # Imported only for a rig with certificates.
    from pincette.security.folder import SOON, Folder

    folder, now = Folder(Path(rig.bus.pki)), now or datetime.now(UTC)
    found: list[Facts] = []
    well = True
    for who in _programs(rig):
        try:
            found.append(_seen(folder, who, now, _host(rig, who)))
        except SecurityError as error:
            well = False
            yield Finding(False, f"certificates: {error}", "docs/how-to/secure.md explains how")
    try:
        read_revoked(folder.path)
    except SecurityError as error:
        well = False
        yield Finding(False, f"certificates: {error}", "no program of the loop starts without it")
    if soon := [facts for facts in found if facts.ends - now < SOON]:
        yield _ending(soon, folder, now)
    elif well:
        first = min(facts.ends for facts in found)
        yield Finding(True, f"certificates: all valid, the first expires on {first:%Y-%m-%d}")


def _programs(rig: RigFile) -> tuple[Identity, ...]:
    beside = ("recorder",) if rig.simulation is None else ("recorder", "rig")
    own = tuple(program(name, rig.rig.name) for name in (*rig.programs, *beside))
    if rig.joins:
        return own
    above = () if rig.bus.upstream is None else (program(UPSTREAM, ""),)
    return program(ROUTER, ""), *above, program(SUPERVISOR, ""), *own


def _host(rig: RigFile, who: Identity) -> str:
    """Return the host at which others connect to a program; empty if no program does."""
    if who.role == UPSTREAM and rig.bus.upstream_at is not None:
        return rig.bus.upstream_at[0]
    if who.role == SUPERVISOR:
        own = rig.supervisor
        # A wildcard address is not contained in a certificate.
        return "" if not own.tls or own.host in ("0.0.0.0", "::") else own.host
    return rig.bus.host if who.serves else ""


def _seen(folder: "Folder", who: Identity, now: datetime, host: str) -> "Facts":
    """Return the content of a certificate if it is valid; raises SecurityError."""
    from pincette.security.folder import checked

    files = folder.credentials(who)
    here = files.private_key.exists()
    facts = checked(files, now) if here or not files.certificate.exists() else folder.facts(who)
    if host and host not in facts.hosts:
        raise SecurityError(
            f"{who.name} is reached at {host}, but its certificate is for "
            f"{', '.join(facts.hosts) or 'no host'}: make a folder with `--host {host}`"
        )
    return facts


def _ending(soon: "Iterable[Facts]", folder: "Folder", now: datetime) -> Finding:
    listed = sorted(soon, key=lambda facts: facts.ends)
    left = (listed[0].ends - now).days
    names = ", ".join(facts.identity.name for facts in listed)
    return noted(
        f"certificates: {names}: {left} days left",
        f"`pincette security renew {folder.path}`, then restart the programs while the rig is idle",
    )


def _loopback(host: str) -> bool:
    return host in ("localhost", "::1") or host.startswith("127.")
