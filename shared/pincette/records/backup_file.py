"""Backup file of a data folder. A restore checks the backup completely before it keeps any file."""

import gzip
import hashlib
import io
import json
import os
import shutil
import sqlite3
import tarfile
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import IO, Any, cast
from zlib import error as ZlibError

from pincette import __version__
from pincette.core.files import make_folder, sync_folder

JOURNAL, KEYS, MODELS, RECORDS, JOINED = (
    "supervisor.sqlite",
    "keys.json",
    "models",
    "jobs",
    "joined",
)
MANIFEST = "backup.json"
PRIVATE = 0o600
"""File mode of journal and keys, which only their owner may read."""
OWNED = 0o700
"""File mode of the folders of restored data."""
CHUNK = 2**20
"""Largest number of bytes that are in memory at once."""
MOST_FILES = 500_000
MOST_MANIFEST = 128 * 2**20
"""Size of the largest list of digests that is read, in bytes."""
RATIO, ALWAYS = 200, 64 * 2**20
"""A backup unpacks to at most ``RATIO`` times its own size plus ``ALWAYS`` bytes; a larger one is
rejected as a decompression bomb."""
DAMAGED = (OSError, EOFError, tarfile.TarError, ZlibError, ValueError, KeyError, RecursionError)
"""Errors that a damaged or crafted file raises when it is read."""


class _Hashed(io.RawIOBase):
    """Stream that hashes the bytes that are read."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream, self.sum = stream, hashlib.sha256()

    def read(self, size: int = -1, /) -> bytes:
        content = self._stream.read(size)
        self.sum.update(content)
        return content


class _Bounded(io.RawIOBase):
    """Content of a compressed file, limited in its total size and in the size of each read.

    Without these limits, the archive reader would load names and attributes of any length into
    memory, and skip contents of any length.
    """

    def __init__(self, stream: IO[bytes], most: int) -> None:
        self._stream, self._most = stream, most

    def read(self, size: int = -1, /) -> bytes:
        if not 0 <= size <= CHUNK:
            raise ValueError(f"it has a header of {size} bytes, limit {CHUNK}")
        self._require(self._stream.tell() + size)
        return self._stream.read(size)

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        if whence == os.SEEK_SET:
            self._require(offset)
        return self._stream.seek(offset, whence)

    def tell(self) -> int:
        return self._stream.tell()

    def _require(self, end: int) -> None:
        if end > self._most + CHUNK:  # the end of an archive is padded
            raise ValueError(f"it unpacks to more than {self._most} bytes")


def write(draft: Path, journal: Path, data: Path, *, records: bool) -> list[str]:
    """Write a backup with a copy of the journal; return the names of its files.

    The caller publishes the draft, which syncs it.
    """
    digests: dict[str, str] = {}
    opener = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, PRIVATE)
    with (
        os.fdopen(opener, "wb") as stream,
        tarfile.open(fileobj=stream, mode="w:gz", compresslevel=6) as archive,
    ):
        for name, path in [(JOURNAL, journal), *_files(data, records=records)]:
            with path.open("rb") as source:
                state, hashed = os.fstat(source.fileno()), _Hashed(source)
                _add(archive, name, state.st_size, cast("IO[bytes]", hashed), state.st_mtime)
            digests[name] = hashed.sum.hexdigest()
        now = datetime.now(UTC)
        about = {
            "pincette": __version__,
            "made_at": now.isoformat(timespec="seconds"),
            "files": digests,
        }
        content = json.dumps(about, indent=2).encode()
        _add(archive, MANIFEST, len(content), io.BytesIO(content), now.timestamp())
    return sorted(digests)


def _add(
    archive: tarfile.TarFile, name: str, size: int, content: IO[bytes], modified_s: float
) -> None:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode, entry.mtime = size, PRIVATE, int(modified_s)
    archive.addfile(entry, content)


def _files(data: Path, *, records: bool) -> Iterator[tuple[str, Path]]:
    """Yield names and paths of the files beside the journal."""
    folders = [MODELS, *([RECORDS] if records else [])]
    bases = [data, *sorted((data / JOINED).glob("*"))]
    found = [
        data / KEYS,
        *(path for base in bases for part in folders for path in _all(base / part)),
    ]
    for path in found:
        if path.is_file() and not path.is_symlink() and path.suffix != ".part":
            yield path.relative_to(data).as_posix(), path


def _all(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def restore(file: Path, data: Path, read_keys: Callable[[Path], object]) -> list[str]:
    """Restore a data folder from a backup; return the names of its files.

    Everything is unpacked to a separate folder and checked before any file is moved to its place.
    ``read_keys`` reads the keys of a folder, and raises an error for damaged ones. Raises
    ``DAMAGED``, and leaves the folder as it was.
    """
    made = not data.exists()
    make_folder(data, OWNED)
    aside = Path(tempfile.mkdtemp(prefix=".restore-", dir=data))
    try:
        names = _unpack(file, aside, read_keys)
        # The journal is moved last: without it the folder does not count as one with data.
        for path in sorted(aside.iterdir(), key=lambda path: path.name == JOURNAL):
            sync_folder(data)  # so that the earlier files survive a power cut if the journal does
            path.rename(data / path.name)
        sync_folder(data)
    except BaseException:
        shutil.rmtree(aside, ignore_errors=True)
        if made:
            data.rmdir()
        raise
    aside.rmdir()
    return names


def _unpack(file: Path, folder: Path, read_keys: Callable[[Path], object]) -> list[str]:
    """Unpack and check a backup; raises ``DAMAGED``."""
    most = RATIO * file.stat().st_size + ALWAYS
    free = shutil.disk_usage(folder).free
    digests: dict[str, str] = {}
    about, total = b"", 0
    with (
        gzip.open(file) as stream,
        tarfile.open(
            fileobj=cast("IO[bytes]", _Bounded(cast("IO[bytes]", stream), most)), mode="r:"
        ) as archive,
    ):
        for entry in archive:
            cast("Any", archive).members.clear()  # otherwise the entries would fill the memory
            name = _require_name(entry)
            if name in digests or (name == MANIFEST and about):
                raise ValueError(f"it has {name} twice")
            if len(digests) >= MOST_FILES:
                raise ValueError(f"it has more than {MOST_FILES} files")
            total += entry.size
            if total > most:
                raise ValueError(f"it unpacks to more than {most} bytes")
            if total > free:
                raise ValueError(
                    f"it unpacks to {total} bytes or more, {free} are free in {folder}"
                )
            content = archive.extractfile(entry)
            assert content is not None  # it is a regular file
            if name == MANIFEST:
                if entry.size > MOST_MANIFEST:
                    raise ValueError(f"{name} has {entry.size} bytes, limit {MOST_MANIFEST}")
                about = b"".join(_chunks(content))
                continue
            digests[name] = _write(folder / name, content, entry)
    wanted = _digests(about)
    for name, digest in digests.items():
        if wanted.get(name) != digest:
            raise ValueError(f"{name} has been changed")
    if missing := wanted.keys() - digests.keys():
        raise ValueError(f"{min(missing)} is missing")
    if JOURNAL not in digests:
        raise ValueError(f"{JOURNAL} is missing")
    _require_sound(folder, read_keys)
    return sorted(digests)


def _require_sound(folder: Path, read_keys: Callable[[Path], object]) -> None:
    """Raise ValueError if journal or keys were already damaged when the backup was made."""
    place = (folder / JOURNAL).absolute().as_uri()
    try:
        with closing(sqlite3.connect(f"{place}?mode=ro&immutable=1", uri=True)) as journal:
            found = [str(row[0]) for row in journal.execute("PRAGMA quick_check(1)")]
    except sqlite3.Error as error:
        raise ValueError(f"{JOURNAL} in it is damaged: {error}") from error
    if found != ["ok"]:
        raise ValueError(f"{JOURNAL} in it is damaged: {' '.join(found)}")
    if not (folder / KEYS).exists():
        return
    with tempfile.TemporaryDirectory(dir=folder) as alone:
        shutil.copyfile(folder / KEYS, Path(alone) / KEYS)
        try:
            read_keys(Path(alone))
        except Exception as error:
            raise ValueError(f"{KEYS} in it is damaged: no supervisor starts with it") from error


def _chunks(content: IO[bytes]) -> Iterable[bytes]:
    return iter(lambda: content.read(CHUNK), b"")


def _write(path: Path, content: IO[bytes], entry: tarfile.TarInfo) -> str:
    """Write one file; return its digest. Raises ValueError if its name is that of a folder."""
    try:
        make_folder(path.parent, OWNED)
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE)
    except (FileExistsError, NotADirectoryError) as error:
        raise ValueError(f"it has {entry.name!r} as a file and as a folder") from error
    digest, written = hashlib.sha256(), 0
    with os.fdopen(number, "wb") as stream:
        for chunk in _chunks(content):
            digest.update(chunk)
            written += stream.write(chunk)
        stream.flush()
        os.fsync(stream.fileno())
    if written != entry.size:
        raise ValueError(f"it ends within {entry.name!r}")
    sync_folder(path.parent)
    return digest.hexdigest()


def _require_name(entry: tarfile.TarInfo) -> str:
    """Return the name of a file if a backup may contain it; otherwise raises ValueError."""
    name = entry.name
    parts = PurePosixPath(name).parts
    plain = entry.isreg() and not entry.issparse() and "/".join(parts) == name
    known = parts in ((JOURNAL,), (KEYS,), (MANIFEST,)) or (
        len(parts) >= 2 and parts[0] in (MODELS, RECORDS)
    )
    joined = len(parts) >= 4 and parts[0] == JOINED and parts[2] in (MODELS, RECORDS)
    if not (plain and (known or joined)) or ".." in parts or not name.isprintable():
        raise ValueError(f"it has {name!r}, which does not belong in a backup")
    return name


def _digests(content: bytes) -> dict[str, str]:
    """Return the digests that the manifest lists; raises ValueError."""
    if not content:
        raise ValueError(f"{MANIFEST} is missing")
    about: Any = json.loads(content)
    listed: Any = cast("dict[str, Any]", about).get("files") if isinstance(about, dict) else None
    if isinstance(listed, dict):
        return {name: str(digest) for name, digest in cast("dict[str, Any]", listed).items()}
    raise ValueError(f"{MANIFEST} lists no files")
