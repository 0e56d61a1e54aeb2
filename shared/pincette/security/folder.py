"""The folder of certificates, of an authority and of each program and person, and their check."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from pincette.core.files import make_folder, replace_file, sync_folder
from pincette.security import certificates
from pincette.security.certificates import Facts, Pair
from pincette.security.identity import AUTHORITY, Credentials, Identity, SecurityError
from pincette.security.revocation import begin_revoked, note_revoked, read_revoked

SOON = timedelta(days=30)
"""Remaining validity of a certificate below which it should be renewed."""
CERTIFICATE, KEY = ".crt", ".key"
SECRET, PUBLIC, OWNED = 0o600, 0o644, 0o700


@dataclass(frozen=True, slots=True)
class Folder:
    """Certificates and keys below one folder; the name of a certificate gives its path."""

    path: Path

    def begin(self, now: datetime, days: float) -> None:
        """Create an empty folder, for its owner alone, with a new authority.

        Raises SecurityError.
        """
        try:
            make_folder(self.path, OWNED)
            taken = any(self.path.iterdir())
        except OSError as error:
            raise SecurityError(f"folder {self.path}: {error.strerror}") from error
        if taken:
            raise SecurityError(
                f"folder {self.path} is not empty, and its files are not overwritten: name a "
                "new one, or use `pincette security add`, `issue` and `renew` with this one"
            )
        self.path.chmod(OWNED)
        begin_revoked(self.path)
        self._write(AUTHORITY, certificates.new_authority(now, days))

    def issue(
        self, identity: Identity, hosts: Sequence[str], now: datetime, days: float
    ) -> Credentials:
        """Create a certificate with its key; raises SecurityError if there is one already."""
        self._write(identity.name, self._signed(identity, hosts, now, days))
        return self.credentials(identity)

    def renew(self, identity: Identity, now: datetime, days: float) -> Credentials:
        """Replace a certificate by a new one, with another key, for the same hosts."""
        hosts = self.facts(identity).hosts
        self._write(identity.name, self._signed(identity, hosts, now, days), again=True)
        return self.credentials(identity)

    def revoke(self, identity: Identity) -> None:
        """Revoke a person's certificate, and remove it from the folder; raises SecurityError."""
        note_revoked(self.path, self.facts(identity).serial, identity.name)
        self.remove(identity)

    def replace(self, identity: Identity, now: datetime, days: float) -> Credentials:
        """Revoke a program's certificate, and create a new one; raises SecurityError."""
        serial = self.facts(identity).serial
        read_revoked(self.path)  # otherwise a new one would exist while the old one is not revoked
        credentials = self.renew(identity, now, days)
        note_revoked(self.path, serial, identity.name)
        return credentials

    def remove(self, identity: Identity) -> None:
        """Remove a certificate from the folder, and its key if it is there."""
        for suffix in (CERTIFICATE, KEY):
            self._place(identity.name, suffix).unlink(missing_ok=True)
        sync_folder(self._place(identity.name, KEY).parent)

    def credentials(self, identity: Identity) -> Credentials:
        """Return the paths of an identity's files, whether or not they exist."""
        return Credentials(
            identity,
            self._place(AUTHORITY, CERTIFICATE),
            self._place(identity.name, CERTIFICATE),
            self._place(identity.name, KEY),
        )

    def facts(self, identity: Identity) -> Facts:
        """Return the content of an identity's certificate; raises SecurityError."""
        place = self._place(identity.name, CERTIFICATE)
        try:
            return certificates.read(_content(place))
        except ValueError as error:
            raise SecurityError(f"{place}: {error}") from error

    def authority(self) -> Facts:
        """Return the content of the authority's own certificate."""
        return self.facts(Identity(AUTHORITY, AUTHORITY))

    def all(self) -> Iterator[Facts]:
        """Return every certificate of this authority whose path corresponds to its name."""
        above = _content(self._place(AUTHORITY, CERTIFICATE))
        for place in sorted([*self.path.glob("*.crt"), *self.path.glob("*/*.crt")]):
            name = place.relative_to(self.path).with_suffix("").as_posix()
            if name == AUTHORITY:
                continue
            found = _content(place)
            try:
                facts, believed = certificates.read(found), certificates.signed_by(found, above)
            except ValueError as error:
                raise SecurityError(f"{place}: {error}") from error
            if believed and facts.identity.name == name:
                yield facts

    def named(self, name: str) -> Identity:
        """Return the identity with a name; raises SecurityError if it has no certificate."""
        known = {facts.identity.name: facts.identity for facts in self.all()}
        if name not in known:
            raise SecurityError(
                f"{name!r} has no certificate in {self.path}; there are: "
                f"{', '.join(known) or 'none'}"
            )
        return known[name]

    def rigs(self) -> tuple[str, ...]:
        """Return the rigs whose programs have certificates."""
        return tuple(dict.fromkeys(one.identity.rig for one in self.all() if one.identity.rig))

    def _signed(self, identity: Identity, hosts: Sequence[str], now: datetime, days: float) -> Pair:
        above = Pair(
            _content(self._place(AUTHORITY, CERTIFICATE)), _content(self._place(AUTHORITY, KEY))
        )
        try:
            return certificates.issue(above, identity, hosts, now, days)
        except ValueError as error:
            raise SecurityError(f"authority in {self.path}: {error}") from error

    def _place(self, name: str, suffix: str) -> Path:
        return self.path / f"{name}{suffix}"

    def _write(self, name: str, pair: Pair, *, again: bool = False) -> None:
        """Write both files, each atomically.

        The key is written first, so that no certificate exists without a key.
        """
        parts = ((KEY, SECRET, pair.private_key), (CERTIFICATE, PUBLIC, pair.certificate))
        try:
            make_folder(self._place(name, KEY).parent, OWNED)
            for suffix, mode, text in parts:
                place = self._place(name, suffix)
                if place.exists() and not again:
                    raise SecurityError(f"{place} exists already, and is not overwritten")
                replace_file(place, text, mode)
        except OSError as error:
            raise SecurityError(f"{name} in {self.path}: {error.strerror}") from error


def checked(credentials: Credentials, now: datetime) -> Facts:
    """Return a certificate's content; raises SecurityError if it does not fit key and authority."""
    authority = _content(credentials.authority)
    certificate = _content(credentials.certificate)
    private_key = _content(credentials.private_key)
    name, place = credentials.identity.name, credentials.certificate
    try:
        facts = certificates.read(certificate)
        believed = certificates.signed_by(certificate, authority)
        whole = certificates.belongs(Pair(certificate, private_key))
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
            f"{place} is signed by another authority than {credentials.authority}: all "
            "programs need certificates of the same authority"
        )
    if not whole:
        raise SecurityError(f"{credentials.private_key} is not the key of {place}")
    if now < facts.begins:
        raise SecurityError(
            f"certificate of {name}, {place}: valid from {facts.begins:%Y-%m-%d %H:%M} UTC, "
            f"but the time here is {now:%Y-%m-%d %H:%M} UTC: set this machine's clock"
        )
    if now >= facts.ends:
        raise SecurityError(
            f"certificate of {name}, {place}: expired on {facts.ends:%Y-%m-%d}: `pincette "
            f"security renew {credentials.authority.parent} {name}`"
        )
    return facts


def _content(path: Path) -> bytes:
    """Return the bytes of a file; raises SecurityError if it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise SecurityError(
            f"{path}: {error.strerror}: `pincette security` makes certificates"
        ) from error
