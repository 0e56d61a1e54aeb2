"""``pincette backup``, ``restore`` and ``audit``: the stored data of a supervisor.

A backup is one file. The audit log records every action over REST with its operator; the command
can verify that it is complete.
"""

import os
import sqlite3
import tarfile
import tempfile
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, BadParameter, Option

from pincette.cli import CliError
from pincette.cli.access import Address
from pincette.cli.keys import opened_keys
from pincette.cli.options import DATA, DataFolder, Limit
from pincette.cli.readers import integer
from pincette.cli.terminal import Json, clock, command, emit, group, patience, table
from pincette.core.files import publish
from pincette.records import backup_file
from pincette.records.backup_file import JOURNAL

if TYPE_CHECKING:
    from pincette.api.access import AuditChain, AuditEntry


VERIFY = "verify"
STORE_URL = "PINCETTE_STORE"
"""URL of a PostgreSQL database that replaces the journal's file."""
File = Annotated[Path, Argument(metavar="FILE", help="such as bench.tar.gz")]

app = group()


@command(app, "backup")
def backup(
    form: Json,
    file: File,
    data: DataFolder = DATA,
    records: Annotated[bool, Option("--records", help="with the records of all jobs")] = False,
) -> None:
    """Write journal, recipes, models and keys to one file; the supervisor may be running.

    The journal contains jobs, results, recipes and alarms. Since the file contains keys, keep it
    secret.
    """
    journal = data / JOURNAL
    if os.environ.get(STORE_URL):
        raise CliError(
            f"the journal is on the server of {STORE_URL}: `pg_dump` copies it; keys, models and "
            f"records are files of {data}, which `tar` copies"
        )
    if not journal.is_file():
        raise CliError(f"{journal} does not exist: name the folder with --data")
    draft = file.with_name(file.name + ".part")
    try:
        parent = file.absolute().parent
        with tempfile.TemporaryDirectory(dir=parent) as work, patience("copying"):
            copy = Path(work) / JOURNAL
            _copy_journal(journal, copy)
            names = backup_file.write(draft, copy, data, records=records)
        publish(draft, file)
    except (OSError, sqlite3.Error, tarfile.TarError) as error:
        draft.unlink(missing_ok=True)
        raise CliError(f"{file} cannot be written: {error}") from error
    size_MB = file.stat().st_size / 1e6
    text = f"{file}: {len(names)} files, {size_MB:.1f} MB; `pincette restore {file} --data FOLDER`"
    form.answer({"file": str(file), "files": names}, text)


def _copy_journal(journal: Path, copy: Path) -> None:
    """Copy a database while other programs write to it; SQLite's own backup function makes a
    consistent copy.

    Raises CliError if the journal cannot be read, and sqlite3.Error if the copy fails.
    """
    # No other program opens the copy, so it may be on a file system without locks.
    copied = f"{copy.absolute().as_uri()}?nolock=1"
    place = f"{journal.absolute().as_uri()}?mode=ro"
    with (
        closing(sqlite3.connect(place, uri=True)) as source,
        closing(sqlite3.connect(copied, uri=True)) as target,
    ):
        try:
            # Without this, ``backup`` would wait forever for a lock that it cannot get.
            source.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        except sqlite3.DatabaseError as error:
            raise CliError(
                f"{journal} cannot be read: {error}; end the program that keeps it locked. "
                "If there is none, its file system has no locks, like many network shares: "
                "copy the folder to a local disk while no supervisor runs, and back up the "
                "copy"
            ) from error
        source.backup(target)


@command(app, "restore")
def restore(form: Json, file: File, data: DataFolder = DATA) -> None:
    """Restore a data folder from a backup.

    Before any file is replaced, all files are checked by their SHA-256, and the journal and the
    keys for damage.
    """
    if data.exists() and not data.is_dir():
        raise CliError(f"{data} is not a folder: name another with --data")
    if data.exists() and any(data.iterdir()):
        raise CliError(f"{data} is not empty: name another folder with --data, or move it away")
    if not file.is_file():
        raise CliError(
            f"{file} does not exist or is not a file: name a backup of `pincette backup`"
        )
    try:
        with patience("checking"):
            names = backup_file.restore(file, data, _read_keys)
    except backup_file.DAMAGED as error:
        raise CliError(
            f"{file} cannot be restored, and nothing was written: {error or 'it is damaged'}"
        ) from error
    text = f"{data}: {len(names)} files; `pincette up --data {data}` starts a rig with them"
    form.answer({"data": str(data), "files": names}, text)


def _read_keys(folder: Path) -> None:
    with opened_keys(folder) as keys:
        keys.all()


def _verify(text: str) -> str:
    if text != VERIFY:
        raise BadParameter(f"{text!r}: expected {VERIFY} or nothing")
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
        Option(
            "--link", metavar="LINK", help="link noted earlier: check that it is still in the log"
        ),
    ] = None,
) -> None:
    """List entries of the audit log, the newest first; or verify that no entry is missing or
    changed.
    """
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
        return "the log is consistent, but the link is not in it: it was written again"
    noted = "" if chain.found is None else "; the link is in the log"
    return (
        f"{chain.entries} entries, {chain.first} to {chain.newest}, each linked to the one "
        f"before it{noted}. Note the newest link elsewhere: {chain.link}"
    )


def _audit_row(one: "AuditEntry") -> tuple[str, ...]:
    from rich.markup import escape

    what = " ".join([one.action.replace("/api/v1", "", 1), one.detail]).strip()
    times = f" ({one.count} times)" if one.count > 1 else ""
    cells = (clock(one.at), escape(one.who), one.address, escape(what + times))
    return (str(one.number), *cells, str(one.status))
