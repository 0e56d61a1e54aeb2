"""Certificates that were withdrawn before their end: a file of their serial numbers."""

# A list that whoever can write the folder can write, as everything that the folder says. The
# guard of each program reads it where it has changed.

import os
from dataclasses import dataclass, field
from pathlib import Path

from pincette.security.identity import SecurityError

REVOKED = "revoked"
"""In a folder of certificates: one serial number a line, in hex, then whose it was."""
HEX = 16


def note_revoked(folder: Path, serial: int, name: str) -> None:
    """Add a certificate to the list; raises SecurityError."""
    place = folder / REVOKED
    try:
        with place.open("a", encoding="ascii") as file:
            file.write(f"{serial:x} {name}\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise SecurityError(f"{place}: {error.strerror}") from error


def read_revoked(folder: Path) -> frozenset[int]:
    """Serial numbers on the list; ValueError for a line that is none, OSError but for no list."""
    place = folder / REVOKED
    try:
        lines = place.read_text(encoding="ascii").splitlines()
    except FileNotFoundError:
        return frozenset()
    return frozenset(int(line.split()[0], HEX) for line in lines if line.strip())


@dataclass(slots=True)
class RevocationList:
    """The list as it is on the disk; what cannot be read keeps what was known."""

    folder: Path
    _serials: frozenset[int] = frozenset()
    _seen: tuple[int, int] | None = field(default=None)

    def changed(self) -> bool:
        """Read the list where it is another one than before; whether it was."""
        try:
            found = (self.folder / REVOKED).stat()
            seen = found.st_mtime_ns, found.st_size
            if seen == self._seen:
                return False
            self._serials, self._seen = read_revoked(self.folder), seen
        except (OSError, ValueError):
            return False
        return True

    def holds(self, serial: int) -> bool:
        """Whether a certificate is on the list."""
        self.changed()
        return serial in self._serials
