"""Keys as the command line makes them, beside a supervisor that runs or does not."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path

from pincette.api.access_models import KeyView, Scope
from pincette_supervisor.access.secret import digest_of, new_key
from pincette_supervisor.config import STORE
from pincette_supervisor.journal.keys import KeyBook, KeyNameTakenError, KeyRow
from pincette_supervisor.journal.rows import utc_now
from pincette_supervisor.journal.store import Store


class KeyStore:
    """The keys in a data folder."""

    def __init__(self, book: KeyBook) -> None:
        self._book = book

    def add(self, name: str, scope: Scope, days: float | None) -> tuple[str, KeyView]:
        """Make a key, which is told this once; raises ValueError where the name is taken."""
        key, expires_at = new_key(), None
        if days is not None:
            end = datetime.now(UTC) + timedelta(days=days)
            expires_at = end.isoformat(timespec="milliseconds").replace("+00:00", "Z")
        try:
            row = self._book.add(name, digest_of(key), scope, expires_at)
        except KeyNameTakenError as error:
            raise ValueError(
                f"there is, or was, a key {name!r}: the audit log names it; take another name"
            ) from error
        return key, _view(row)

    def all(self) -> list[KeyView]:
        """Every key there is or was."""
        return [_view(row) for row in self._book.all()]

    def revoke(self, name: str) -> bool:
        """Take a key out of force; false where there is none to be."""
        return self._book.revoke(name)


def _view(row: KeyRow) -> KeyView:
    columns = asdict(row)
    del columns["digest"]
    return KeyView(**columns, usable=row.usable(utc_now()))


@contextmanager
def open_keys(data: Path) -> Generator[KeyStore]:
    """Open the keys of a data folder, which is made where there is none.

    Raises
    ------
    StoreError
        Where the journal cannot be used.
    """
    store = Store(data / STORE)
    try:
        yield KeyStore(KeyBook(store))
    finally:
        store.close()
