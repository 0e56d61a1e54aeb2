"""Deletion of records, if the rig file limits their age or size."""

import logging
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pincette.records import folder as files

log = logging.getLogger(__name__)
NEWEST = 10
"""Number of records that are never deleted, whatever their age and size."""


@dataclass(frozen=True, slots=True)
class Kept:
    """Folder of a job that has ended."""

    name: str
    size: int


def records_to_delete(
    kept: Sequence[Kept],
    ages_s: Mapping[str, float],
    keep_s: float | None,
    keep_bytes: int | None,
) -> list[str]:
    """Return the records to delete, oldest first: those that are too old, and further ones until
    the others together are small enough.

    ``ages_s`` holds the age of each record in s by its name, oldest first.
    """
    place = {name: number for number, name in enumerate(ages_s)}
    ordered = sorted(kept, key=lambda item: place[item.name])
    total = sum(item.size for item in ordered)
    names: list[str] = []
    for item in ordered[:-NEWEST]:
        old = keep_s is not None and ages_s[item.name] > keep_s
        many = keep_bytes is not None and total > keep_bytes
        if not (old or many):
            break
        names.append(item.name)
        total -= item.size
    return names


def ended(records: Path) -> list[Kept]:
    """Return jobs that have ended, according to a manifest, and are not pinned; raises OSError.

    They are sorted by the modification time of their manifests, oldest first. ``CountedTime`` uses
    this order for records that it has not seen before.
    """
    found: list[tuple[float, Kept]] = []
    for manifest in records.glob(f"*/{files.MANIFEST}"):
        folder = manifest.parent
        if folder.is_symlink() or folder.name.startswith(files.DELETED_PREFIX):
            continue
        if (folder / files.PINNED).exists():
            continue
        size = sum(path.stat().st_size for path in folder.iterdir() if path.is_file())
        found.append((manifest.stat().st_mtime, Kept(folder.name, size)))
    return [item for _, item in sorted(found, key=lambda pair: (pair[0], pair[1].name))]


def delete(records: Path, name: str) -> None:
    """Rename a record, so that it is no longer found, and delete it. Raises OSError."""
    files.delete(records, name)
    log.info("%s: deleted, as [recorder] in the rig file states", name)


def sweep(records: Path) -> None:
    """Continue deletions that an earlier run began; raises OSError."""
    for grave in records.glob(f"{files.DELETED_PREFIX}*"):
        shutil.rmtree(grave)
