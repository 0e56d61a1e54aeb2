"""Folder of a job: its files by name, samples as Parquet with units, documents, a manifest."""

import hashlib
import json
import shutil
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

from pincette.core.files import (
    DRAFT,
    make_folder,
    publish,
    replace_file,
    replacing,
    sync_folder,
)
from pincette.records import mcap_file, parquet, record_times
from pincette.records.columns import COLUMNS, SECOND_COLUMNS, Columns
from pincette.records.parquet import Field

LIVE = mcap_file.NAME
SAMPLES = "samples.parquet"
BURST = "burst.parquet"
TIMING = "timing.json"
REQUEST, RESULT, MANIFEST = "request.json", "result.json", "manifest.json"
REPORT = "report.html"
PINNED = ".pinned"
"""Name of the file that marks a record to be kept, whatever its age."""
CLOCK_AGREED = ".clock-agreed"
"""Name of the file by which a person confirms the time of day after the clock was changed."""
DELETED_PREFIX = ".deleted-"
"""Start of a folder's name while it is being deleted."""
DRAWN = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".svg": "image/svg+xml",
    ".pdf": "application/pdf",
    ".html": "text/html; charset=utf-8",
    ".json": "application/json",
}
"""Media types of plots and pictures of the camera, by extension."""
MEDIA_TYPES = {
    LIVE: "application/octet-stream",
    SAMPLES: "application/vnd.apache.parquet",
    BURST: "application/vnd.apache.parquet",
    TIMING: "application/json",
    REQUEST: "application/json",
    RESULT: "application/json",
    REPORT: "text/html; charset=utf-8",
    MANIFEST: "application/json",
}

OF_SAMPLES = (
    Field("seq", "", "number of the sample", "int"),
    Field("t_s", "s", "time since sample 0: number of the sample times the period", "float"),
    *COLUMNS,
)
OF_A_BURST = (
    Field("x_um", "µm", "position of the tip, x", "float"),
    Field("drive_V", "V", "drive at the amplifier's input, as measured", "float"),
)


def write_samples(path: Path, table: Columns, about: Mapping[str, str]) -> None:
    """Write columns as Parquet."""
    with replacing(path) as draft:
        two = SECOND_COLUMNS if SECOND_COLUMNS[0].name in table else ()
        parquet.write(draft, (*OF_SAMPLES, *two), table, about)


class SamplesDraft:
    """Table of samples that is written part by part, and published from time to time."""

    def __init__(self, path: Path, about: Mapping[str, str], *, two_arms: bool) -> None:
        self._path, self._about = path, about
        self._fields = (*OF_SAMPLES, *(SECOND_COLUMNS if two_arms else ()))
        self._draft = path.with_name(path.name + DRAFT)
        self._writer: parquet.Writer | None = None
        self._rows = 0
        """Number of rows that were added."""

    def add(self, table: Columns) -> None:
        """Add rows; raises OSError."""
        self._opened().add(table)
        self._rows += len(table["seq"])

    def _opened(self) -> parquet.Writer:
        """Return the writer of the draft, beginning with the rows of an earlier table."""
        if self._writer is None:
            self._writer = parquet.writer(self._draft, self._fields, self._about)
            if self._rows:
                self._writer.copy(self._path, self._rows)
        return self._writer

    def publish(self, rest: Columns, about: Mapping[str, str]) -> None:
        """Replace the published table by all rows so far and those of ``rest``.

        ``about`` is the metadata of the table. More rows may be added later, including those of
        ``rest``.
        """
        writer = self._opened()
        writer.add(rest)
        writer.describe(about)
        writer.close()
        self._writer = None
        publish(self._draft, self._path)

    def discard(self) -> None:
        """Delete the draft."""
        if self._writer is not None:
            with suppress(OSError):
                self._writer.close()
            self._writer = None
        self._draft.unlink(missing_ok=True)


def times(folder: Path) -> dict[str, str]:
    """Return the UTC times that the table of samples states; empty if there is no table."""
    try:
        about = parquet.read_about(folder / SAMPLES)
    except (OSError, ValueError):
        return {}
    return {name: about[name] for name in record_times.NAMES if name in about}


def write_burst(
    path: Path, x_um: Sequence[float], drive_V: Sequence[float], about: Mapping[str, str]
) -> None:
    """Write a buffered acquisition as Parquet; ``about`` contains its rate."""
    with replacing(path) as draft:
        parquet.write(draft, OF_A_BURST, {"x_um": x_um, "drive_V": drive_V}, about)


def write_json(path: Path, tree: Mapping[str, Any]) -> None:
    """Write a JSON document for people."""
    text = json.dumps(tree, indent=2, ensure_ascii=False, allow_nan=False)
    replace_file(path, f"{text}\n".encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write the bytes of a file."""
    replace_file(path, content)


def pin(folder: Path, *, pinned: bool) -> None:
    """Mark a record to be kept whatever its age, or remove the mark."""
    if pinned:
        make_folder(folder)
        (folder / PINNED).touch()
        sync_folder(folder)
    elif (folder / PINNED).exists():
        (folder / PINNED).unlink()
        sync_folder(folder)


def agree_to_clock(records: Path) -> None:
    """Store for the recorder that a person confirms the time of day; raises OSError."""
    (records / CLOCK_AGREED).touch()
    sync_folder(records)


def delete(records: Path, name: str) -> None:
    """Rename a record, so that it is no longer found, and delete it. Raises OSError."""
    grave = records / f"{DELETED_PREFIX}{name}"
    (records / name).rename(grave)
    sync_folder(records)
    shutil.rmtree(grave)


def media_type(name: str) -> str | None:
    """Return the media type of a file of a record; None if a record has no such file."""
    return MEDIA_TYPES.get(name) or DRAWN.get(Path(name).suffix)


def artifacts(folder: Path) -> list[dict[str, Any]]:
    """Return the files of a record, each with its size and SHA-256."""
    found: list[dict[str, Any]] = []
    names = {path.name for end in DRAWN for path in folder.glob(f"*{end}")}
    for name in (*MEDIA_TYPES, *sorted(names - MEDIA_TYPES.keys())):
        path = folder / name
        try:
            state = path.stat()
            digest = _sha256(path, state.st_size, state.st_mtime_ns)
        except FileNotFoundError:
            continue
        found.append(
            {"name": name, "media_type": media_type(name), "bytes": state.st_size, "sha256": digest}
        )
    return found


@lru_cache(maxsize=512)
def _sha256(path: Path, _size: int, _changed_ns: int) -> str:
    """Return the SHA-256 of a file, which is read again only if its size or time has changed."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_manifest(
    folder: Path, about: Mapping[str, Any], names: Collection[str] | None = None
) -> None:
    """Write the manifest: the files of the record, its owner, and whether it is complete.

    Call it when all of these files are on the disk. ``names`` are the files to list with their
    present content.
    """
    files = [
        entry
        for entry in artifacts(folder)
        if entry["name"] != MANIFEST and (names is None or entry["name"] in names)
    ]
    if names is not None:
        files += [entry for entry in listed(folder) if entry["name"] not in names]
    write_json(folder / MANIFEST, {**about, "files": files})


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest; empty if it is missing or unreadable."""
    with suppress(OSError, ValueError):
        tree: Any = json.loads((folder / MANIFEST).read_bytes())
        if isinstance(tree, dict):
            return cast("dict[str, Any]", tree)
    return {}


def listed(folder: Path) -> list[dict[str, Any]]:
    """Return the files that the manifest lists; empty if it cannot be read."""
    found = read_manifest(folder).get("files")
    entries = cast("list[Any]", found) if isinstance(found, list) else []
    return [
        cast("dict[str, Any]", one)
        for one in entries
        if isinstance(one, dict) and isinstance(cast("dict[str, Any]", one).get("name"), str)
    ]


def newest(records: Path, count: int) -> list[Path]:
    """Return the folders of the most recently written records; raises OSError."""
    found = {path.parent for name in (LIVE, MANIFEST) for path in records.glob(f"*/{name}")}
    kept = [
        one for one in found if not one.is_symlink() and not one.name.startswith(DELETED_PREFIX)
    ]
    return sorted(kept, key=lambda folder: folder.stat().st_mtime)[-count:]


def damaged(folder: Path) -> list[str]:
    """Return the names of files that are missing or differ from the manifest.

    If the manifest is missing or unreadable, only its own name is returned. Raises OSError.
    """
    entries = listed(folder)
    if not entries:
        return [MANIFEST]
    return [entry["name"] for entry in entries if not _is_as_listed(folder, entry)]


def _is_as_listed(folder: Path, entry: Mapping[str, Any]) -> bool:
    path = folder / Path(entry["name"]).name
    try:
        state = path.stat()
        # Compare sizes first: most damage is a truncated file, which needs no digest.
        return state.st_size == entry.get("bytes") and entry.get("sha256") == _sha256(
            path, state.st_size, state.st_mtime_ns
        )
    except FileNotFoundError:
        return False
