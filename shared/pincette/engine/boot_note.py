"""Note of how the previous program ended, in a file that the program itself writes.

The supervisor may have been absent, or have crashed at the same time. Therefore the program notes
that it runs before it serves requests, and that it has ended cleanly after it has come to rest.
"""

import logging
import os
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import msgspec

from pincette.config import RigFile
from pincette.control.quantities import Whole
from pincette.core.faults import Predecessor
from pincette.core.files import make_folder, replace_file

RUNNING = "running"

_log = logging.getLogger(__name__)


def boot_note(rig: RigFile, service: str, data: Path) -> "BootNote":
    """Return the note of one service of a rig; the file is in the folder of the rig's records."""
    return BootNote(rig.home(data) / f"{service}-{rig.rig.name}.json")


class Before(NamedTuple):
    """How the previous program of the same service ended."""

    ended: Predecessor = Predecessor.NONE
    instance: int | None = None
    """Number of the start of the previous program; None if it was not noted."""


FIRST = Before()
"""Result if no previous program is known."""


class _Note(msgspec.Struct):
    """Content of the file."""

    ended: str
    instance: Whole | None = None


class BootNote:
    """One small file, which is replaced atomically and is on the disk before a call returns."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def found(self) -> Before:
        """Return how the previous program has ended.

        If the note cannot be read or replaced, the program counts as not cleanly ended.
        """
        found = self._read()
        if found.ended is Predecessor.CLEAN and not self._write(*found):
            return Before(Predecessor.DIED)
        return found

    def begin(self) -> None:
        """Note that the program runs; call this before it replies to any request.

        On a full disk the file is emptied, which needs no space: an empty note does not count as a
        clean end. Raises OSError if that is not possible.
        """
        if self._write(RUNNING, None):
            return
        try:
            make_folder(self._path.parent)
            with self._path.open("wb") as stream, suppress(OSError):
                os.fsync(stream.fileno())
        except OSError as error:
            raise OSError(
                f"{self._path} cannot be written ({error.strerror}), so the next start could "
                "not know how this run ended: check free space and permissions of the disk, "
                "or name another folder with --data"
            ) from error

    def end(self, ending: Predecessor, instance: int) -> None:
        """Note how the program ended, and the number of its start; call this once it is at rest."""
        if ending is not Predecessor.DIED:
            self._write(ending, instance)

    def _read(self) -> Before:
        try:
            noted = msgspec.json.decode(self._path.read_bytes(), type=_Note)
        except FileNotFoundError:
            return FIRST
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
            _log.warning("%s cannot be read (%s): treated as an unclean end", self._path, error)
            return Before(Predecessor.DIED)
        if noted.ended in (Predecessor.NONE, Predecessor.CLEAN):
            return Before(Predecessor(noted.ended), noted.instance)
        return Before(Predecessor.DIED)

    def _write(self, ended: str, instance: int | None) -> bool:
        try:
            make_folder(self._path.parent)
            replace_file(self._path, msgspec.json.encode(_Note(ended, instance)) + b"\n")
        except OSError as error:
            _log.warning(
                "%s cannot be written (%s): the next start may ask a person for a reset",
                self._path,
                error,
            )
            return False
        return True
