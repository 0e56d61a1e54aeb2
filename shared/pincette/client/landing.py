"""A file on its way from a supervisor to a folder."""

import hashlib
from pathlib import Path
from typing import BinaryIO

from pincette.client.errors import DamagedFileError


class Landing:
    """Written beside its place, and put there once it is whole and has its SHA-256."""

    def __init__(self, name: str, folder: Path, sha256: str | None) -> None:
        if Path(name).name != name:
            raise ValueError(f"{name!r} is no name of a file: it has no folder in it")
        folder.mkdir(parents=True, exist_ok=True)
        self._place, self._part = folder / name, folder / f"{name}.part"
        self._wanted = sha256
        self._file: BinaryIO | None = None

    def begin(self) -> None:
        """Begin anew, whatever came before."""
        self.abandon()
        self._digest = hashlib.sha256()
        self._file = self._part.open("wb")

    def take(self, block: bytes) -> None:
        """Append a block."""
        assert self._file is not None
        self._digest.update(block)
        self._file.write(block)

    def done(self) -> Path:
        """Put the file in its place; raises DamagedFileError where it is another."""
        assert self._file is not None
        self._file.close()
        found = self._digest.hexdigest()
        if self._wanted is not None and found != self._wanted:
            self.abandon()
            raise DamagedFileError(
                f"{self._place.name}: SHA-256 is {found}, the record states {self._wanted}"
            )
        self._part.replace(self._place)
        return self._place

    def abandon(self) -> None:
        """Leave nothing of an attempt behind."""
        if self._file is not None:
            self._file.close()
            self._part.unlink(missing_ok=True)
