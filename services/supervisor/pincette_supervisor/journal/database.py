"""The journal's database: its schema, and transactions for reading and writing."""

import errno
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from sqlalchemy import Column, Connection, Select, column, delete, inspect, select, table
from sqlalchemy.exc import DBAPIError, SQLAlchemyError, StatementError

from pincette.core.files import make_folder
from pincette_supervisor.journal import engines
from pincette_supervisor.process_load import PROCESS_LOAD

MIGRATIONS = Path(__file__).parent / "migrations"
VERSION = table("alembic_version", column("version_num"))
"""Table in which Alembic stores the version of the schema."""
KEY_FILE = "keys.json"
"""Name of the key file, in the folder of the journal."""
TURN_S = 10.0
"""Longest time for which a write waits for earlier writes, in s."""
MOVE_AWAY = "move it away to start a new one"
SEE_DISK = "check the disk's free space and permissions"
USE_LOCAL_DISK = "keep the data folder on a local disk (--data FOLDER)"
USE_OTHER_PLACE = (
    "its file system lacks what a journal needs (locks, memory maps), like many network "
    f"shares: {USE_LOCAL_DISK}, or the journal in PostgreSQL (PINCETTE_STORE). The journal "
    "itself is not known to be damaged: leave it where it is, or copy it"
)
DAMAGE = frozenset({"SQLITE_CORRUPT", "SQLITE_NOTADB"})
NO_LOCKS = frozenset(
    {errno.EBADF, errno.EIO, errno.EINVAL, errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS}
)
"""Error numbers of ``flock`` on file systems without locks."""
UNFIT = frozenset({"SQLITE_IOERR", "SQLITE_NOLFS", "SQLITE_PROTOCOL"})
"""Error codes of SQLite on file systems that lack what it needs."""
SEE_SERVER = "check that the server runs and admits this account, and that the database exists"
T = TypeVar("T")


class StoreError(OSError):
    """Error raised if the store cannot be used; the text states the file and the remedy."""


class _UnknownSchemaError(Exception):
    """Error raised if the schema of the file is unknown to this program."""


class Database:
    """One database; safe to use from several threads, never from the event loop.

    ``path`` is the file of the journal; its folder also contains other files, such as the keys.
    With ``url``, the rows are in a PostgreSQL database instead.
    """

    def __init__(self, path: Path, url: str = "") -> None:
        self._path = path
        self._place = str(path)
        self._let_go: Callable[[], None] | None = None
        self._closed = False
        self.troubles: dict[str, str] = {}
        """Problems that threads of the supervisor report, by the cause of the alarm to raise."""
        self.trouble = ""
        """Reason why the last write failed; empty if it succeeded."""
        # SQLite polls for its write lock; a lock of our own serves writers in order.
        self._turn = threading.RLock()
        self._written: Connection | None = None
        """The open write transaction, for nested ``writing``."""
        remedy = MOVE_AWAY
        try:
            if url:
                remedy, self._place = SEE_SERVER, "of PINCETTE_STORE"
                server = engines.server_url(url)
                self._place = server.render_as_string(hide_password=True)
                make_folder(path.parent)
                self._engine = engines.open_server(server)
            else:
                self._engine = engines.open_file(path)
            self._remedy = remedy
            self._writer = engines.writing(self._engine)
            with self._engine.begin() as connection:
                engines.require_sound(connection)
            with self._writer.begin() as connection:
                engines.migrate_alone(connection)
                _migrate(connection)
        except _UnknownSchemaError as error:
            self.close()
            raise StoreError(
                f"the job store {self._place} {error}: use the version that wrote it, or {remedy}"
            ) from error
        except ModuleNotFoundError as error:
            raise StoreError(
                f"the job store {self._place} needs a driver: pip install 'pincette[postgresql]'"
            ) from error
        except (SQLAlchemyError, OSError, ValueError) as error:
            self.close()
            cause = error.orig if isinstance(error, DBAPIError) else error
            found = remedy if url else _remedy_of(cause)
            raise StoreError(
                f"the job store {self._place} cannot be used: {cause}; {found}"
            ) from error

    def work_alone(self) -> None:
        """Exclude other supervisors until closed; raises StoreError."""
        try:
            self._let_go = engines.work_alone(self._engine, self._path)
        except ValueError as error:
            raise StoreError(f"the job store {self._place} cannot be used: {error}") from error
        except (DBAPIError, OSError) as error:
            raise StoreError(
                f"the job store {self._place} cannot be locked: {error}; {self._remedy_of(error)}"
            ) from error

    def _remedy_of(self, error: Exception) -> str:
        if self._remedy == SEE_SERVER:
            return SEE_SERVER
        return _remedy_of(error.orig if isinstance(error, DBAPIError) else error)

    @property
    def folder(self) -> Path:
        """Return the folder of the file."""
        return self._path.parent

    @contextmanager
    def reading(self) -> Generator[Connection]:
        """Open a transaction that sees one state of the database; raises StoreError."""
        self._require_open()
        try:
            with self._engine.begin() as connection:
                yield connection
        except DBAPIError as error:
            raise self._failed(error) from error

    @contextmanager
    def writing(self) -> Generator[Connection]:
        """Open an atomic transaction, which a nested one joins.

        Raises StoreError, or ValueError for a value that JSON cannot represent.

        It also raises StoreError if an earlier write has not ended within ``TURN_S``, as on a disk
        that has stopped responding: no request waits for such a disk forever.
        """
        with self._in_turn():
            self._require_open()
            if self._written is not None:
                yield self._written
                return
            try:
                with PROCESS_LOAD.at("journal"), self._writer.begin() as connection:
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

    @contextmanager
    def _in_turn(self) -> Generator[None]:
        if not self._turn.acquire(timeout=TURN_S):
            raise StoreError(
                f"the job store {self._place} is not written: another write has been in "
                f"progress for {TURN_S:g} s; check whether the disk responds"
            )
        try:
            yield
        finally:
            self._turn.release()

    def rows(self, kind: Callable[..., T], query: Select[Any]) -> list[T]:
        """Return the rows of a query in a separate transaction; see ``rows``; raises StoreError."""
        with self.reading() as connection:
            return rows(connection, kind, query)

    def _require_open(self) -> None:
        if self._closed:
            raise StoreError(f"the job store {self._place} is closed")

    def _failed(self, error: DBAPIError) -> StoreError:
        return StoreError(f"the job store {self._place}: {error.orig}; {self._remedy_of(error)}")

    def close(self) -> None:
        """Close the file."""
        with self._turn:
            self._closed = True
            if self._let_go is not None:
                self._let_go()
                self._let_go = None
            engine = getattr(self, "_engine", None)
            if engine is not None:
                engine.dispose()


def _remedy_of(cause: BaseException | None) -> str:
    """Return the remedy for an error of the journal's file, or of its file system."""
    name = getattr(cause, "sqlite_errorname", "")
    primary = "_".join(name.split("_")[:2])  # SQLITE_IOERR for SQLITE_IOERR_LOCK
    if primary in DAMAGE or isinstance(cause, ValueError):
        return MOVE_AWAY
    if primary == "SQLITE_BUSY":
        # SQLite also reports a file system without locks (ENOLCK) this way.
        return f"another program keeps it locked: end that one. If there is none, {USE_OTHER_PLACE}"
    unfit = isinstance(cause, OSError) and cause.errno in NO_LOCKS
    return USE_OTHER_PLACE if unfit or primary in UNFIT else SEE_DISK


def rows(connection: Connection, kind: Callable[..., T], query: Select[Any]) -> list[T]:
    """Return the rows of a query as objects of a class whose fields have the columns' names."""
    return [kind(**row) for row in connection.execute(query).mappings()]


def first(connection: Connection, kind: Callable[..., T], query: Select[Any]) -> T | None:
    """Return the first row of a query like ``rows``; None without a row."""
    return next(iter(rows(connection, kind, query.limit(1))), None)


def keep_newest(
    connection: Connection, key: Column[Any], kept: int, *newest_first: Any, **values: object
) -> None:
    """Delete all rows of a table except the newest, among those with these column values.

    Parameters
    ----------
    key
        Column whose value differs for each of these rows.
    newest_first
        Order in which the newest row is the first.
    """
    query = matching(select(key), **values).order_by(*newest_first).offset(kept)
    if gone := list(connection.scalars(query)):
        connection.execute(delete(key.table).where(key.in_(gone)).filter_by(**values))


def columns(row: Any, *without: str) -> dict[str, Any]:
    """Return the values of a row's columns, except some."""
    return {name: value for name, value in asdict(row).items() if name not in without}


def matching(query: Select[Any], **values: object) -> Select[Any]:
    """Return a query restricted to columns with these values; None does not restrict."""
    return query.filter_by(**{name: value for name, value in values.items() if value is not None})


def _migrate(connection: Connection) -> None:
    """Create or upgrade the tables within the connection's transaction."""
    newest = max(path.name[1:5] for path in (MIGRATIONS / "versions").glob("v*.py"))
    tables = inspect(connection).get_table_names()
    if VERSION.name in tables and list(connection.scalars(select(VERSION))) == [newest]:
        return
    # Alembic and what it loads take 10 MB, and most starts find the newest schema.
    from alembic import command
    from alembic.config import Config
    from alembic.runtime.migration import MigrationContext
    from alembic.script import ScriptDirectory

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.attributes["connection"] = connection
    known = [step.revision for step in ScriptDirectory.from_config(config).walk_revisions()]
    present = MigrationContext.configure(connection).get_current_heads()
    for revision in present:
        if revision not in known:
            raise _UnknownSchemaError(f"has schema {revision}, this program knows {known[0]}")
    if not present and tables:
        raise _UnknownSchemaError(f"has a schema without a number, this program knows {known[0]}")
    command.upgrade(config, "head")
