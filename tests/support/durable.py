"""A folder as a power cut leaves it, on a disk that keeps only what was synced.

This is stricter than any file system: a file has the content of its last sync, and a folder the
entries of its own last sync. A file whose entry was synced and whose content never was is empty.
"""

import os
import stat
from pathlib import Path
from typing import NamedTuple

import pytest


class _Entry(NamedTuple):
    """One entry of a folder when that folder was synced."""

    inode: int
    is_folder: bool


class Durable:
    """Records syncs of this process, and copies what they made durable."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self._contents: dict[int, bytes] = {}
        self._entries: dict[int, dict[str, _Entry]] = {}
        patch.setattr(os, "fsync", self._sync)
        patch.setattr(os, "fdatasync", self._sync)

    def _sync(self, number: int) -> None:
        state, place = os.fstat(number), Path(f"/proc/self/fd/{number}")
        if stat.S_ISDIR(state.st_mode):
            with os.scandir(number) as found:
                self._entries[state.st_ino] = {
                    one.name: _Entry(one.inode(), one.is_dir(follow_symlinks=False))
                    for one in found
                }
        else:
            self._contents[state.st_ino] = place.read_bytes()

    def cut(self, folder: Path, target: Path) -> Path:
        """Copy the durable content of a folder, whose own entry counts as durable, to
        ``target``."""
        self._copy(folder.stat().st_ino, target)
        return target

    def _copy(self, inode: int, target: Path) -> None:
        target.mkdir()
        for name, entry in self._entries.get(inode, {}).items():
            if entry.is_folder:
                self._copy(entry.inode, target / name)
            else:
                (target / name).write_bytes(self._contents.get(entry.inode, b""))
