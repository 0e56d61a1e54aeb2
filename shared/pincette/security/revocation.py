"""Certificates that were revoked before their end: a file of their serial numbers.

The list ends with the SHA-256 of its content, so that a truncated list is not mistaken for a
shorter one. It is created with the folder, so that a lost list is not mistaken for one that was
never needed.
"""

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pincette.core.files import replace_file
from pincette.security.identity import SecurityError

log = logging.getLogger("pincette")
REVOKED = "revoked"
"""File in a folder of certificates: one serial number per line, in hex, with its owner; the
checksum is the last line."""
HEX, SUM = 16, "sha256"
REMEDY = (
    "copy it from another machine of the rig, or from a backup; if no certificate was ever "
    "revoked, `pincette security revoke --anew {folder}` starts an empty one; else make a "
    "new folder"
)


def begin_revoked(folder: Path) -> None:
    """Write an empty list; raises SecurityError."""
    _write(folder, ())


def note_revoked(folder: Path, serial: int, name: str) -> None:
    """Add a certificate to the list; raises SecurityError, also for a damaged list."""
    _write(folder, [*_rows(folder), f"{serial:x} {name}"])


def read_revoked(folder: Path) -> frozenset[int]:
    """Return the listed serial numbers; raises SecurityError if the list is missing or damaged."""
    return frozenset(int(row.split()[0], HEX) for row in _rows(folder))


def _rows(folder: Path) -> list[str]:
    place, remedy = folder / REVOKED, REMEDY.format(folder=folder)
    try:
        text = place.read_text(encoding="ascii")
    except OSError as error:
        why = f"list of revoked certificates {place}: {error.strerror}"
        raise SecurityError(f"{why}: {remedy}") from error
    except ValueError as error:
        raise SecurityError(f"{place} is damaged: {remedy}") from error
    *rows, last = text.splitlines() or [""]
    if last != _sum(rows) or not text.endswith("\n"):
        raise SecurityError(f"{place} is damaged: its last line is not its checksum: {remedy}")
    return rows


def _sum(rows: Sequence[str]) -> str:
    return f"{SUM} {hashlib.sha256(chr(10).join(rows).encode()).hexdigest()}"


def _write(folder: Path, rows: Sequence[str]) -> None:
    """Write the list completely or not at all."""
    place = folder / REVOKED
    try:
        replace_file(place, "".join(f"{row}\n" for row in (*rows, _sum(rows))).encode("ascii"))
    except OSError as error:
        raise SecurityError(f"{place}: {error.strerror}") from error


@dataclass(slots=True)
class RevocationList:
    """The list in a running program: it grows, and never shrinks.

    A list that cannot be read at the start raises SecurityError. Later the known entries are kept.
    """

    folder: Path
    _serials: frozenset[int] = field(init=False)
    _seen: tuple[int, int] | None = field(init=False)
    _trouble: str = field(init=False, default="")

    def __post_init__(self) -> None:
        self._seen = self._stamp()
        self._serials = read_revoked(self.folder)

    def changed(self) -> bool:
        """Read the list if its file has changed; return whether it has more entries."""
        seen = self._stamp()
        if seen == self._seen:
            return False
        before = self._serials
        try:
            self._serials = before | read_revoked(self.folder)
        except SecurityError as error:
            if str(error) != self._trouble:  # the file is read again at each check
                log.error("certificates revoked from now on are not known: %s", error)
            self._trouble = str(error)
        else:
            self._seen, self._trouble = seen, ""
        return self._serials != before

    def holds(self, serial: int) -> bool:
        """Return whether a certificate is on the list."""
        self.changed()
        return serial in self._serials

    def _stamp(self) -> tuple[int, int] | None:
        """Return a stamp that differs between two versions of the list.

        None if there is no list.
        """
        try:
            found = (self.folder / REVOKED).stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_size
