"""Which records are deleted, where the rig file says that they do not stay for ever."""

import logging
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pincette.records import folder as files

log = logging.getLogger(__name__)
NEWEST = 10
"""So many are never deleted, whatever their age and size."""


@dataclass(frozen=True, slots=True)
class Kept:
    """The folder of a job that has ended."""

    name: str
    ended_s: float
    """In seconds of UTC."""
    size: int


def doomed(
    kept: Sequence[Kept], now_s: float, keep_s: float | None, keep_bytes: int | None
) -> list[str]:
    """Records to be deleted, the oldest first: for their age, then for the size of all; pure."""
    ordered = sorted(kept, key=lambda item: (item.ended_s, item.name))
    total = sum(item.size for item in ordered)
    names: list[str] = []
    for item in ordered[:-NEWEST]:
        old = keep_s is not None and now_s - item.ended_s > keep_s
        many = keep_bytes is not None and total > keep_bytes
        if not (old or many):
            break
        names.append(item.name)
        total -= item.size
    return names


def ended(records: Path) -> list[Kept]:
    """Jobs that have ended, as a manifest shows, and are not pinned; raises OSError."""
    found: list[Kept] = []
    for manifest in records.glob(f"*/{files.MANIFEST}"):
        folder = manifest.parent
        if folder.is_symlink() or folder.name.startswith(files.DOOMED):
            continue
        if (folder / files.PINNED).exists():
            continue
        size = sum(path.stat().st_size for path in folder.iterdir() if path.is_file())
        found.append(Kept(folder.name, manifest.stat().st_mtime, size))
    return found


def delete(records: Path, name: str) -> None:
    """Delete a record; at once it is no longer found under its name. Raises OSError."""
    files.delete(records, name)
    log.info("%s: deleted, as [recorder] of the rig file asks for", name)


def sweep(records: Path) -> None:
    """Go on with what an earlier run began to delete; raises OSError."""
    for grave in records.glob(f"{files.DOOMED}*"):
        shutil.rmtree(grave)
