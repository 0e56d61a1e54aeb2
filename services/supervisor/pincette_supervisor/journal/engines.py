"""The two kinds of journal: an SQLite file, or a database of a PostgreSQL server."""

import fcntl
import json
import os
import re
import sqlite3
import stat
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, cast

import msgspec
from sqlalchemy import (
    URL,
    Connection,
    Engine,
    create_engine,
    event,
    make_url,
    text,
)
from sqlalchemy.exc import ArgumentError, DBAPIError
from sqlalchemy.pool import ConnectionPoolEntry

from pincette.core.files import make_folder

BUSY_S = 10.0
"""Time that a statement waits for another program's lock on the file, or for the server, in s."""
POOL, OVERFLOW = 8, 64
"""Number of connections that are kept open, and of additional ones: together more than there are
threads."""
WRITES = "journal_writes"
PRIVATE = 0o600
SERVER = "postgresql"
DRIVER = "postgresql+psycopg"
ALONE, MIGRATING = 0x70696E63, 0x70696E64
"""Advisory locks of the supervisor that works with a schema, and of the program that creates its
tables."""
NUL = re.compile(r"(?<!\\)((?:\\\\)*)\\u0000")
"""Escape of the character that PostgreSQL cannot store in a text."""
_to_json = partial(json.dumps, allow_nan=False, ensure_ascii=False)


def server_url(url: str) -> URL:
    """Return the address of a PostgreSQL database; raises ValueError."""
    try:
        found = make_url(url)
    except ArgumentError as error:
        raise ValueError(f"it is not a URL such as {SERVER}://user@host/database") from error
    if found.drivername not in (SERVER, DRIVER):
        raise ValueError(
            f"{found.drivername} is not supported: expected {SERVER}://user@host/database"
        )
    return found.set(drivername=DRIVER)


def open_file(path: Path) -> Engine:
    """Open an SQLite file that only its owner can read; it is created if it does not exist."""
    make_folder(path.parent)
    _keep_private(path)
    engine = create_engine(
        URL.create("sqlite+pysqlite", database=str(path)),
        connect_args={"timeout": BUSY_S},
        pool_size=POOL,
        max_overflow=OVERFLOW,
        json_serializer=_to_json,
        json_deserializer=msgspec.json.decode,  # three times as fast as json.loads
    )
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    return engine


def open_server(url: URL) -> Engine:
    """Open a database of a server; raises ModuleNotFoundError without its driver."""
    engine = create_engine(
        url,
        connect_args={"connect_timeout": int(BUSY_S), "application_name": "pincette"},
        pool_size=POOL,
        max_overflow=OVERFLOW,
        pool_pre_ping=True,
        # A reader sees one state of the database, as in a file.
        isolation_level="REPEATABLE READ",
        json_serializer=_to_server_json,
    )
    event.listen(engine, "before_cursor_execute", _without_nul, retval=True)
    return engine


def _to_server_json(value: Any) -> str:
    return NUL.sub(r"\1\\ufffd", _to_json(value))


def _without_nul(
    _connection: Connection, _cursor: Any, statement: str, parameters: Any, *_: Any
) -> tuple[str, Any]:
    """Replace characters that PostgreSQL cannot store in a text."""

    def clean(row: Any) -> Any:
        if not isinstance(row, dict):
            return row
        values = cast("dict[str, Any]", row)
        return {
            name: one.replace("\0", "\N{REPLACEMENT CHARACTER}") if isinstance(one, str) else one
            for name, one in values.items()
        }

    if isinstance(parameters, list):
        return statement, [clean(row) for row in cast("list[Any]", parameters)]
    return statement, clean(parameters)


def writing(engine: Engine) -> Engine:
    """Return the same engine for transactions that write."""
    if engine.dialect.name == SERVER:
        return engine.execution_options(isolation_level="READ COMMITTED")
    return engine.execution_options(**{WRITES: True})


def require_sound(connection: Connection) -> None:
    """Raise ValueError with the first error found if the file is damaged, before a job needs the
    file.
    """
    if connection.dialect.name == SERVER:
        return
    found = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar()
    if found != "ok":
        raise ValueError(f"it is damaged: {' '.join(str(found).split())}")


def migrate_alone(connection: Connection) -> None:
    """Wait until no other program creates the tables of this schema."""
    if connection.dialect.name == SERVER:
        connection.execute(
            text("SELECT pg_advisory_xact_lock(:key, hashtext(current_schema()))"),
            {"key": MIGRATING},
        )


def work_alone(engine: Engine, path: Path) -> Callable[[], None]:
    """Exclude other supervisors from a journal until the returned function is called.

    The lock is the system's or the server's, so it ends with the process in any case.

    Raises
    ------
    ValueError
        Another supervisor works with it.
    """
    if engine.dialect.name != SERVER:
        return _lock_beside(path)
    connection = engine.connect().execution_options(isolation_level="AUTOCOMMIT")
    query = text("SELECT pg_try_advisory_lock(:key, hashtext(current_schema()))")
    if connection.scalar(query, {"key": ALONE}):

        def let_go() -> None:
            # The server ends the lock of a closed connection some time later; a supervisor that
            # starts again at once must not meet it.
            with suppress(DBAPIError):
                connection.scalar(
                    text("SELECT pg_advisory_unlock(:key, hashtext(current_schema()))"),
                    {"key": ALONE},
                )
            connection.close()

        return let_go
    connection.close()
    raise ValueError(
        "another supervisor uses it: give each a database of its own, or a schema "
        "(?options=-csearch_path%3DNAME)"
    )


def _lock_beside(path: Path) -> Callable[[], None]:
    """Lock a separate file: closing the journal's own file would release SQLite's locks."""
    lock = os.open(path.with_name(f"{path.name}-alone"), os.O_RDWR | os.O_CREAT, PRIVATE)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(lock)
        raise ValueError(
            "another supervisor uses it: stop that one, or give each a folder of its own (--data)"
        ) from error
    except OSError:
        os.close(lock)
        raise
    return partial(os.close, lock)


def _keep_private(path: Path) -> None:
    """Make the file readable only by its owner; SQLite gives its other files the same mode."""
    # An existing file is not opened: closing it again would take SQLite's locks from this
    # process, and another one that closes the journal would remove the log that is in use.
    with suppress(OSError):  # SQLite reports a file that cannot be opened
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, PRIVATE))
    with suppress(OSError):
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            path.chmod(PRIVATE)


def _prepare(connection: sqlite3.Connection, _entry: ConnectionPoolEntry) -> None:
    # Otherwise the driver begins transactions automatically, but not before CREATE TABLE.
    connection.isolation_level = None
    # Large sorts stay in memory: they would fail with a full temporary folder.
    pragmas = "journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON", "temp_store = MEMORY"
    for pragma in pragmas:
        connection.execute(f"PRAGMA {pragma}")


def _begin(connection: Connection) -> None:
    # A transaction that reads first and then writes fails if another has written meanwhile.
    writes = connection.get_execution_options().get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
