"""The journal's data base in use: transactions for reading and for writing, its errors in words."""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Connection
from sqlalchemy.exc import DBAPIError, SQLAlchemyError, StatementError

from pincette_supervisor.journal.engine import for_writing, open_engine
from pincette_supervisor.journal.migrate import ForeignSchemaError, migrate


class StoreError(OSError):
    """The store cannot be used; the text says which file, and what to do."""


class Base:
    """One data base; safe to use from several threads, never from the event loop."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._closed = False
        self.trouble = ""
        """Why the last change could not be written; empty where it was."""
        # SQLite lets those who wait to write try by turns; a lock serves them one after another.
        self._turn = threading.RLock()
        self._written: Connection | None = None
        """The transaction of whoever has the turn."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._engine = open_engine(path)
        self._writer = for_writing(self._engine)
        try:
            with self._writer.begin() as connection:
                migrate(connection)
        except ForeignSchemaError as error:
            self.close()
            raise StoreError(
                f"the job store {path} {error}: use the version that wrote it, "
                "or move the file away"
            ) from error
        except (SQLAlchemyError, OSError, ValueError) as error:
            self.close()
            raise self._unusable(error) from error

    def _unusable(self, error: Exception) -> StoreError:
        told = error.orig if isinstance(error, DBAPIError) else error
        return StoreError(
            f"the job store {self._path} cannot be used: {told}; move it away to begin a new one"
        )

    @contextmanager
    def reading(self) -> Generator[Connection]:
        """A transaction that sees one state of the data base.

        Raises
        ------
        StoreError
            Where the data base cannot be used.
        """
        self._require_open()
        try:
            with self._engine.begin() as connection:
                yield connection
        except DBAPIError as error:
            raise self._failed(error) from error

    @contextmanager
    def writing(self) -> Generator[Connection]:
        """A transaction that is kept wholly or not at all, one at a time.

        Within another of the same thread it is part of that one.

        Raises
        ------
        StoreError
            Where the data base cannot be used.
        ValueError
            Where a value has no form in JSON.
        """
        with self._turn:
            self._require_open()
            if self._written is not None:
                yield self._written
                return
            try:
                with self._writer.begin() as connection:
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
