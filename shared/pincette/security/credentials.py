"""What one program or person proves itself with: where its files are, seen to be in order."""

from datetime import datetime, timedelta
from pathlib import Path

from pincette.security.certificates import Facts, Pair, belongs, read, signed_by
from pincette.security.identity import Credentials, SecurityError

SOON = timedelta(days=30)
"""Within this before its end a certificate should be renewed."""


def checked(credentials: Credentials, now: datetime) -> Facts:
    """What the certificate says, once all three files have been seen to fit together.

    Raises
    ------
    SecurityError
        Where a file is missing or unreadable, or the certificate is another's, of another
        authority, of another key, not valid yet or not valid any more.
    """
    authority = content(credentials.authority)
    certificate = content(credentials.certificate)
    private_key = content(credentials.private_key)
    name, place = credentials.identity.name, credentials.certificate
    try:
        facts = read(certificate)
        believed = signed_by(certificate, authority)
        whole = belongs(Pair(certificate, private_key))
    except ValueError as error:
        raise SecurityError(f"certificate of {name}, {place}: {error}") from error
    if facts.identity != credentials.identity:
        other = facts.identity
        raise SecurityError(
            f"{place} is the certificate of {other.name} ({other.role}), not of {name} "
            f"({credentials.identity.role})"
        )
    if not believed:
        raise SecurityError(
            f"{place} is signed by another authority than {credentials.authority}: all programs "
            "need certificates of the same one"
        )
    if not whole:
        raise SecurityError(f"{credentials.private_key} is not the key of {place}")
    if now < facts.begins:
        raise SecurityError(
            f"certificate of {name}, {place}: begins on {facts.begins:%Y-%m-%d %H:%M} UTC, and "
            f"here it is {now:%Y-%m-%d %H:%M} UTC: set this machine's clock"
        )
    if now >= facts.ends:
        raise SecurityError(
            f"certificate of {name}, {place}: ended on {facts.ends:%Y-%m-%d}: "
            f"`pincette security renew {credentials.authority.parent} {name}`"
        )
    return facts


def content(path: Path) -> bytes:
    """Bytes of a file; raises SecurityError where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise SecurityError(
            f"{path}: {error.strerror}: `pincette security` makes certificates"
        ) from error
