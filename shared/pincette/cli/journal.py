"""``pincette backup``, ``restore`` and ``audit``: what a supervisor keeps.

A backup is one file. The audit log says who did what over REST; it can be verified to be whole.
"""

import hashlib
import io
import json
import os
import sqlite3
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, BadParameter, Option

from pincette import __version__
from pincette.cli import CliError
from pincette.cli.access import Address
from pincette.cli.options import DATA, DataFolder, Limit, integer
from pincette.cli.terminal import Json, clock, command, emit, group, patience, table

if TYPE_CHECKING:
    from pincette.api.access import AuditChain, AuditEntry


JOURNAL, KEYS, MODELS, RECORDS, JOINED = (
    "supervisor.sqlite",
    "keys.json",
    "models",
    "jobs",
    "joined",
)
MANIFEST = "backup.json"
VERIFY = "verify"
STORE_URL = "PINCETTE_STORE"
"""Of a PostgreSQL database in place of the journal's file."""
PRIVATE = 0o600
"""The journal and the keys are read by their owner alone."""
File = Annotated[Path, Argument(metavar="FILE", help="such as bench.tar.gz")]

app = group()


@command(app, "backup")
def backup(
    form: Json,
    file: File,
    data: DataFolder = DATA,
    records: Annotated[bool, Option("--records", help="with the records of all jobs")] = False,
) -> None:
    """Write journal, recipes, models and keys to one file; the supervisor may be at work.

    The journal has jobs, results, recipes and alarms. The file is as secret as the keys in it.
    """
    journal = data / JOURNAL
    if os.environ.get(STORE_URL):
        raise CliError(
            f"the journal is on the server of {STORE_URL}: `pg_dump` copies it; keys, models and "
            f"records are files of {data}, which `tar` copies"
        )
    if not journal.is_file():
        raise CliError(f"{journal} is not there: name the folder with --data")
    draft = file.with_name(file.name + ".part")
    try:
        parent = file.absolute().parent
        with tempfile.TemporaryDirectory(dir=parent) as work, patience("copying"):
            copy = Path(work) / JOURNAL
            _copied(journal, copy)
            names = _written(draft, copy, data, records=records)
        draft.replace(file)
    except (OSError, sqlite3.Error, tarfile.TarError) as error:
        draft.unlink(missing_ok=True)
        raise CliError(f"{file} cannot be written: {error}") from error
    size_MB = file.stat().st_size / 1e6
    text = f"{file}: {len(names)} files, {size_MB:.1f} MB; `pincette restore {file} --data FOLDER`"
    form.answer({"file": str(file), "files": names}, text)


def _copied(journal: Path, copy: Path) -> None:
    """Copy a database that others may be writing to: SQLite's own copy sees one state of it."""
    with (
        closing(sqlite3.connect(f"file:{journal}?mode=ro", uri=True)) as source,
        closing(sqlite3.connect(copy)) as target,
    ):
        source.backup(target)


def _written(draft: Path, journal: Path, data: Path, *, records: bool) -> list[str]:
    digests: dict[str, str] = {}
    opener = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, PRIVATE)
    with (
        os.fdopen(opener, "wb") as stream,
        tarfile.open(fileobj=stream, mode="w:gz", compresslevel=6) as archive,
    ):
        for name, path in [(JOURNAL, journal), *_files(data, records=records)]:
            content = path.read_bytes()
            digests[name] = hashlib.sha256(content).hexdigest()
            _add(archive, name, content, path.stat().st_mtime)
        about = {
            "pincette": __version__,
            "made_at": datetime.now(UTC).isoformat(timespec="seconds"),
            "files": digests,
        }
        content = json.dumps(about, indent=2).encode()
        _add(archive, MANIFEST, content, datetime.now(UTC).timestamp())
    return sorted(digests)


def _add(archive: tarfile.TarFile, name: str, content: bytes, modified_s: float) -> None:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode, entry.mtime = len(content), PRIVATE, int(modified_s)
    archive.addfile(entry, io.BytesIO(content))


def _files(data: Path, *, records: bool) -> Iterator[tuple[str, Path]]:
    """Names and paths of what lies beside the journal."""
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


@command(app, "restore")
def restore(form: Json, file: File, data: DataFolder = DATA) -> None:
    """Make a data folder of a backup; each file is checked by its SHA-256 before any is kept."""
    if data.exists() and any(data.iterdir()):
        raise CliError(f"{data} is not empty: name another folder with --data, or move it away")
    try:
        contents = _read(file)
    except (OSError, tarfile.TarError, ValueError, KeyError) as error:
        raise CliError(f"{file} is no backup that can be used: {error}") from error
    data.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        path = data / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT, PRIVATE), "wb") as stream:
            stream.write(content)
    text = f"{data}: {len(contents)} files; `pincette up --data {data}` starts a rig with them"
    form.answer({"data": str(data), "files": sorted(contents)}, text)


def _read(file: Path) -> dict[str, bytes]:
    """The files of a backup; raises ValueError where one is not what was written."""
    contents: dict[str, bytes] = {}
    with tarfile.open(file) as archive:
        for entry in archive:
            place = PurePosixPath(entry.name)
            if not entry.isfile() or place.is_absolute() or ".." in place.parts:
                raise ValueError(f"it has {entry.name!r}, which is no file of a backup")
            stream = archive.extractfile(entry)
            contents[entry.name] = b"" if stream is None else stream.read()
    about: dict[str, Any] = json.loads(contents.pop(MANIFEST))
    digests: dict[str, str] = about["files"]
    for name, content in contents.items():
        if digests.get(name) != hashlib.sha256(content).hexdigest():
            raise ValueError(f"{name} has been changed")
    if missing := digests.keys() - contents.keys():
        raise ValueError(f"{sorted(missing)[0]} is missing")
    return contents


def _verify(text: str) -> str:
    if text != VERIFY:
        raise BadParameter(f"{text!r}: wanted {VERIFY} or nothing")
    return text


@command(app, "audit")
def audit(
    address: Address,
    what: Annotated[
        str | None,
        Argument(metavar=f"[{VERIFY}]", parser=_verify, help="check that no entry was changed"),
    ] = None,
    limit: Limit = 50,
    before: Annotated[
        int | None,
        Option("--before", parser=integer, metavar="NUMBER", help="entries below this number"),
    ] = None,
    link: Annotated[
        str | None,
        Option("--link", metavar="LINK", help="noted earlier: is it still in the log?"),
    ] = None,
) -> None:
    """List entries of the audit log, the newest first; or verify that it is whole."""
    if what == VERIFY:
        chain = address.supervisor().audit_chain(link)
        if chain.broken is not None or chain.found is False:
            if address.json:
                emit(chain)
            raise CliError(_chain_words(chain))
        address.answer(chain, _chain_words(chain))
        return
    found = address.supervisor().audit(limit, before)
    names = ("number", "time", "who", "from", "what", "answer")
    address.answer(found, table(*names, rows=map(_audit_row, found), right=("number", "answer")))


def _chain_words(chain: "AuditChain") -> str:
    if chain.newest is None:
        return "the audit log is empty"
    if chain.broken is not None:
        return f"entry {chain.broken} was changed, or one before it is missing"
    if chain.found is False:
        return "the log follows from itself, but the link is none of its: it was written anew"
    noted = "" if chain.found is None else "; the link is one of them"
    return (
        f"{chain.entries} entries, {chain.first} to {chain.newest}, each follows from the one "
        f"before it{noted}. Note the newest link elsewhere: {chain.link}"
    )


def _audit_row(one: "AuditEntry") -> tuple[str, ...]:
    from rich.markup import escape

    what = " ".join([one.action.replace("/api/v1", "", 1), one.detail]).strip()
    times = f" ({one.count} times)" if one.count > 1 else ""
    cells = (clock(one.at), escape(one.who), one.address, escape(what + times))
    return (str(one.number), *cells, str(one.status))
