"""The keys of a data folder for the command line, whether or not a supervisor runs."""

from collections.abc import Generator
from contextlib import closing, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

from pincette.api.access import KeyView, Scope
from pincette_supervisor.access.authentication import digest_of, new_key
from pincette_supervisor.access.passwords import hashed
from pincette_supervisor.config import STORE
from pincette_supervisor.journal.access_rows import KeyRepository
from pincette_supervisor.journal.database import columns
from pincette_supervisor.journal.key_file import KeyFile, KeyNameTakenError, KeyRow
from pincette_supervisor.journal.store import Store, StoreError, utc_now
from pincette_supervisor.journal.tables import utc_text


class KeyStore:
    """The keys in a data folder."""

    def __init__(self, repository: KeyRepository | KeyFile) -> None:
        self._repository = repository

    def add(self, name: str, scope: Scope, days: float | None) -> tuple[str, KeyView]:
        """Make a key, which is shown this once; raises ValueError where the name is taken."""
        key, expires_at = new_key(), None
        if days is not None:
            expires_at = utc_text(datetime.now(UTC) + timedelta(days=days))
        try:
            row = self._repository.add(name, digest_of(key), scope, expires_at)
        except KeyNameTakenError as error:
            raise ValueError(
                f"there is, or was, a key {name!r}: the audit log names it; take another name"
            ) from error
        return key, _view(row)

    def add_user(self, name: str, scope: Scope, password: str) -> KeyView:
        """Keep a person who signs in by name and password; raises ValueError as ``add``."""
        try:
            # Of a key that nobody has been told.
            row = self._repository.add(name, digest_of(new_key()), scope, password=hashed(password))
        except KeyNameTakenError as error:
            raise ValueError(
                f"there is, or was, a user or a key {name!r}: take another name"
            ) from error
        return _view(row)

    def set_password(self, name: str, password: str) -> bool:
        """Give a user another password; false where there is no such user in force."""
        return self._repository.set_password(name, hashed(password))

    def all(self, *, users: bool = False) -> list[KeyView]:
        """Every key there is or was; or every user."""
        return [_view(row) for row in self._repository.all() if (row.password is not None) == users]

    def revoke(self, name: str) -> bool:
        """Take a key out of force; false where there is none to be."""
        return self._repository.revoke(name)


def _view(row: KeyRow) -> KeyView:
    return KeyView(**columns(row, "digest", "password"), usable=row.usable(utc_now()))


@contextmanager
def open_keys(data: Path) -> Generator[KeyStore]:
    """Open the keys of a data folder, which is made where there is none; raises StoreError."""
    try:
        store = Store(data / STORE)
    except StoreError:
        file = KeyFile(data)
        if file.read() is None:  # the keys may be in that journal alone
            raise
        yield KeyStore(file)  # a damaged journal keeps nobody from revoking a key
        return
    with closing(store):
        yield KeyStore(KeyRepository(store))
