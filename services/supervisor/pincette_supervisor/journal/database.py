"""The journal's SQLite file: its schema, and transactions for reading and writing."""

import json
import os
import sqlite3
import stat
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import URL, Connection, Engine, Select, create_engine, event, inspect
from sqlalchemy.exc import DBAPIError, SQLAlchemyError, StatementError
from sqlalchemy.pool import ConnectionPoolEntry

from pincette_supervisor.attention import ATTENTION

MIGRATIONS = Path(__file__).parent / "migrations"
BUSY_S = 10.0
"""How long a statement waits for another program that has the file."""
POOL, OVERFLOW = 8, 64
"""Connections kept open, and allowed on top: together more than there are threads."""
WRITES = "journal_writes"
PRIVATE = 0o600
KEY_FILE = "keys.json"
"""Beside the journal; an earlier version kept the keys in the journal alone."""
MOVE_AWAY = (
    f"move it away to begin a new one; where no {KEY_FILE} lies beside it, first set "
    '[supervisor] keys = "always", or the keys go with it'
)
T = TypeVar("T")


class StoreError(OSError):
    """The store cannot be used; the text names the file and the remedy."""


class _UnknownSchemaError(Exception):
    """The file has a schema that this program does not know."""


class Database:
    """One database file; safe to use from several threads, never from the event loop."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._closed = False
        self.trouble = ""
        """Why the last write failed; empty if it succeeded."""
        # SQLite polls for its write lock; a lock of our own serves writers in order.
        self._turn = threading.RLock()
        self._written: Connection | None = None
        """The open write transaction, for nested ``writing``."""
        path.parent.mkdir(parents=True, exist_ok=True)
        _keep_private(path)
        self._engine = _open_engine(path)
        self._writer = self._engine.execution_options(**{WRITES: True})
        try:
            with self._engine.begin() as connection:
                _require_sound(connection)
            with self._writer.begin() as connection:
                _migrate(connection)
        except _UnknownSchemaError as error:
            self.close()
            raise StoreError(
                f"the job store {path} {error}: use the version that wrote it, or {MOVE_AWAY}"
            ) from error
        except (SQLAlchemyError, OSError, ValueError) as error:
            self.close()
            cause = error.orig if isinstance(error, DBAPIError) else error
            raise StoreError(
                f"the job store {path} cannot be used: {cause}; {MOVE_AWAY}"
            ) from error

    @property
    def folder(self) -> Path:
        """Where the file lies."""
        return self._path.parent

    @contextmanager
    def reading(self) -> Generator[Connection]:
        """A transaction that sees one state of the database; raises StoreError."""
        self._require_open()
        try:
            with self._engine.begin() as connection:
                yield connection
        except DBAPIError as error:
            raise self._failed(error) from error

    @contextmanager
    def writing(self) -> Generator[Connection]:
        """An atomic transaction, which a nested one joins; raises StoreError, ValueError (JSON)."""
        with self._turn:
            self._require_open()
            if self._written is not None:
                yield self._written
                return
            try:
                with ATTENTION.at("journal"), self._writer.begin() as connection:
                    self._written = connection
                    yield connection
                self.trouble = ""
            except DBAPIError as error:
                failed = self._failed(error)
                self.trouble = str(failed)
                raise failed from error
            except StatementError as error:
                if isinstance(error.orig, ValueError):
                    raise error.orig from error
                raise
            finally:
                self._written = None

    def rows(self, kind: Callable[..., T], query: Select[Any]) -> list[T]:
        """The rows of a query in a transaction of its own; see ``rows``; raises StoreError."""
        with self.reading() as connection:
            return rows(connection, kind, query)

    def _require_open(self) -> None:
        if self._closed:
            raise StoreError(f"the job store {self._path} is closed")

    def _failed(self, error: DBAPIError) -> StoreError:
        return StoreError(
            f"the job store {self._path}: {error.orig}; look at the disk's room and rights"
        )

    def close(self) -> None:
        """Close the file."""
        with self._turn:
            self._closed = True
            self._engine.dispose()


def rows(connection: Connection, kind: Callable[..., T], query: Select[Any]) -> list[T]:
    """The rows of a query as objects of a kind whose fields are named as the columns."""
    return [kind(**row) for row in connection.execute(query).mappings()]


def columns(row: Any, *without: str) -> dict[str, Any]:
    """The values of a row's columns, some left out."""
    return {name: value for name, value in asdict(row).items() if name not in without}


def matching(query: Select[Any], **values: object) -> Select[Any]:
    """A query restricted to columns with these values; None does not restrict."""
    return query.filter_by(**{name: value for name, value in values.items() if value is not None})


def _keep_private(path: Path) -> None:
    """Let the owner alone read the file; SQLite gives its other files the same mode."""
    with suppress(OSError):  # what cannot be opened is told when SQLite opens it
        os.close(os.open(path, os.O_RDWR | os.O_CREAT, PRIVATE))
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            path.chmod(PRIVATE)


def _require_sound(connection: Connection) -> None:
    """Raise ValueError with the first finding of a damaged file, before a job meets it."""
    found = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar()
    if found != "ok":
        raise ValueError(f"it is damaged: {' '.join(str(found).split())}")


def _open_engine(path: Path) -> Engine:
    engine = create_engine(
        URL.create("sqlite+pysqlite", database=str(path)),
        connect_args={"timeout": BUSY_S},
        pool_size=POOL,
        max_overflow=OVERFLOW,
        json_serializer=partial(json.dumps, allow_nan=False, ensure_ascii=False),
    )
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    return engine


def _prepare(connection: sqlite3.Connection, _entry: ConnectionPoolEntry) -> None:
    # Otherwise the driver begins transactions by itself, and not before CREATE TABLE.
    connection.isolation_level = None
    for pragma in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
        connection.execute(f"PRAGMA {pragma}")


def _begin(connection: Connection) -> None:
    # A transaction that reads first and then writes fails if another has written meanwhile.
    writes = connection.get_execution_options().get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _migrate(connection: Connection) -> None:
    """Create or upgrade the tables within the connection's transaction."""
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.attributes["connection"] = connection
    known = [step.revision for step in ScriptDirectory.from_config(config).walk_revisions()]
    present = MigrationContext.configure(connection).get_current_heads()
    for revision in present:
        if revision not in known:
            raise _UnknownSchemaError(f"has schema {revision}, this program knows {known[0]}")
    if not present and inspect(connection).get_table_names():
        raise _UnknownSchemaError(f"has a schema without a number, this program knows {known[0]}")
    if present != (known[0],):
        command.upgrade(config, "head")
