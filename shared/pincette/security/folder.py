"""The folder of certificates: the authority, one certificate a program, one a person."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from pincette.security import certificates
from pincette.security.certificates import Facts, Pair
from pincette.security.credentials import content
from pincette.security.identity import AUTHORITY, Credentials, Identity, SecurityError

CERTIFICATE, KEY = ".crt", ".key"
SECRET, PUBLIC, OWNED = 0o600, 0o644, 0o700


@dataclass(frozen=True, slots=True)
class Folder:
    """Certificates and keys below one place; a certificate lies where its name says."""

    path: Path

    def begin(self, now: datetime, days: float) -> None:
        """Make the folder, which only its owner may enter, with a new authority in it.

        Raises
        ------
        SecurityError
            Where there is something already, which is never written over.
        """
        try:
            self.path.mkdir(mode=OWNED, parents=True, exist_ok=True)
            taken = any(self.path.iterdir())
        except OSError as error:
            raise SecurityError(f"folder {self.path}: {error.strerror}") from error
        if taken:
            raise SecurityError(
                f"folder {self.path} is not empty, and nothing in it is written over: name a new "
                "one, or use `pincette security add`, `issue` and `renew` with this one"
            )
        self.path.chmod(OWNED)
        self._write(AUTHORITY, certificates.new_authority(now, days))

    def issue(
        self, identity: Identity, hosts: Sequence[str], now: datetime, days: float
    ) -> Credentials:
        """Make a certificate with its key; raises SecurityError where there is one already."""
        self._write(identity.name, self._signed(identity, hosts, now, days))
        return self.credentials(identity)

    def renew(self, identity: Identity, now: datetime, days: float) -> Credentials:
        """Make a certificate anew, with another key, for the same hosts as before."""
        hosts = self.facts(identity).hosts
        self._write(identity.name, self._signed(identity, hosts, now, days), again=True)
        return self.credentials(identity)

    def remove(self, identity: Identity) -> None:
        """Take a certificate, and its key where it is here, out of the folder."""
        for suffix in (CERTIFICATE, KEY):
            self._place(identity.name, suffix).unlink(missing_ok=True)

    def credentials(self, identity: Identity) -> Credentials:
        """Where the files of an identity are, whether they are there or not."""
        return Credentials(
            identity,
            self._place(AUTHORITY, CERTIFICATE),
            self._place(identity.name, CERTIFICATE),
            self._place(identity.name, KEY),
        )

    def facts(self, identity: Identity) -> Facts:
        """What the certificate of an identity says; raises SecurityError."""
        place = self._place(identity.name, CERTIFICATE)
        try:
            return certificates.read(content(place))
        except ValueError as error:
            raise SecurityError(f"{place}: {error}") from error

    def authority(self) -> Facts:
        """What the authority's own certificate says."""
        return self.facts(Identity(AUTHORITY, AUTHORITY))

    def all(self) -> Iterator[Facts]:
        """Every certificate of this authority that lies where its name says, by name.

        Raises
        ------
        SecurityError
            Where the authority's certificate is missing, or a file is no certificate.
        """
        above = content(self._place(AUTHORITY, CERTIFICATE))
        for place in sorted([*self.path.glob("*.crt"), *self.path.glob("*/*.crt")]):
            name = place.relative_to(self.path).with_suffix("").as_posix()
            if name == AUTHORITY:
                continue
            found = content(place)
            try:
                facts, believed = certificates.read(found), certificates.signed_by(found, above)
            except ValueError as error:
                raise SecurityError(f"{place}: {error}") from error
            if believed and facts.identity.name == name:
                yield facts

    def named(self, name: str) -> Identity:
        """The identity that a name stands for; raises SecurityError where it has no certificate."""
        known = {facts.identity.name: facts.identity for facts in self.all()}
        if name not in known:
            raise SecurityError(
                f"{name!r} has no certificate in {self.path}; there are: "
                f"{', '.join(known) or 'none'}"
            )
        return known[name]

    def rigs(self) -> tuple[str, ...]:
        """Rigs whose programs have certificates."""
        return _once(facts.identity.rig for facts in self.all() if facts.identity.rig)

    def _signed(self, identity: Identity, hosts: Sequence[str], now: datetime, days: float) -> Pair:
        above = Pair(
            content(self._place(AUTHORITY, CERTIFICATE)), content(self._place(AUTHORITY, KEY))
        )
        try:
            return certificates.issue(above, identity, hosts, now, days)
        except ValueError as error:
            raise SecurityError(f"authority in {self.path}: {error}") from error

    def _place(self, name: str, suffix: str) -> Path:
        return self.path / f"{name}{suffix}"

    def _write(self, name: str, pair: Pair, *, again: bool = False) -> None:
        """Write both files, each whole or not at all; the key first, that none is without one."""
        parts = ((KEY, SECRET, pair.private_key), (CERTIFICATE, PUBLIC, pair.certificate))
        try:
            self._place(name, KEY).parent.mkdir(mode=OWNED, exist_ok=True)
            for suffix, mode, text in parts:
                place = self._place(name, suffix)
                if place.exists() and not again:
                    raise SecurityError(f"{place} is there already, and is not written over")
                draft = place.with_name(place.name + ".part")
                draft.unlink(missing_ok=True)
                with os.fdopen(
                    os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb"
                ) as file:
                    file.write(text)
                draft.replace(place)
        except OSError as error:
            raise SecurityError(f"{name} in {self.path}: {error.strerror}") from error


def _once(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))
