"""Certificates that were withdrawn before their end: a file of their serial numbers.

The list ends with the SHA-256 of what is before it, so that one that was cut is no shorter list. It
begins with the folder, so that one that is lost is not taken for one that was never needed.
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
"""In a folder of certificates: one serial number a line, in hex, and whose it was; then the sum."""
HEX, SUM = 16, "sha256"
REMEDY = (
    "copy it from another machine of the rig, or from a backup; where nobody was ever revoked, "
    "`pincette security revoke --anew {folder}` begins an empty one; else make a new folder"
)


def begin_revoked(folder: Path) -> None:
    """Write an empty list; raises SecurityError."""
    _write(folder, ())


def note_revoked(folder: Path, serial: int, name: str) -> None:
    """Add a certificate to the list; raises SecurityError, also for a list that is damaged."""
    _write(folder, [*_rows(folder), f"{serial:x} {name}"])


def read_revoked(folder: Path) -> frozenset[int]:
    """Serial numbers on the list; SecurityError where it is missing, damaged or cannot be read."""
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
        raise SecurityError(f"{place} is damaged: its last line is not the sum of it: {remedy}")
    return rows


def _sum(rows: Sequence[str]) -> str:
    return f"{SUM} {hashlib.sha256(chr(10).join(rows).encode()).hexdigest()}"


def _write(folder: Path, rows: Sequence[str]) -> None:
    """Write the list whole or not at all."""
    place = folder / REVOKED
    try:
        replace_file(place, "".join(f"{row}\n" for row in (*rows, _sum(rows))).encode("ascii"))
    except OSError as error:
        raise SecurityError(f"{place}: {error.strerror}") from error


@dataclass(slots=True)
class RevocationList:
    """The list as a running program knows it: it grows, and never shrinks.

    What cannot be read at the start is a SecurityError. Later it keeps what was known.
    """

    folder: Path
    _serials: frozenset[int] = field(init=False)
    _seen: tuple[int, int] | None = field(init=False)
    _trouble: str = field(init=False, default="")

    def __post_init__(self) -> None:
        self._seen = self._stamp()
        self._serials = read_revoked(self.folder)

    def changed(self) -> bool:
        """Read the list where it is another one than before; whether it has more on it."""
        seen = self._stamp()
        if seen == self._seen:
            return False
        before = self._serials
        try:
            self._serials = before | read_revoked(self.folder)
        except SecurityError as error:
            if str(error) != self._trouble:  # it is read again at each look
                log.error("certificates revoked from here on are not known: %s", error)
            self._trouble = str(error)
        else:
            self._seen, self._trouble = seen, ""
        return self._serials != before

    def holds(self, serial: int) -> bool:
        """Whether a certificate is on the list."""
        self.changed()
        return serial in self._serials

    def _stamp(self) -> tuple[int, int] | None:
        """What tells one list from another; None where there is none."""
        try:
            found = (self.folder / REVOKED).stat()
        except OSError:
            return None
        return found.st_mtime_ns, found.st_size
