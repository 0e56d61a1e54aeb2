"""The keys of a data folder for the command line, whether or not a supervisor runs."""

import os
from collections.abc import Generator
from contextlib import closing, contextmanager
from datetime import timedelta
from pathlib import Path

from pincette.api.access import KeyView, Scope
from pincette.security.latest_time import utc
from pincette_supervisor.access.authentication import digest_of, new_key
from pincette_supervisor.access.key_sync import BEHIND, KEY_CLOCK
from pincette_supervisor.access.passwords import hashed
from pincette_supervisor.config import STORE, STORE_URL
from pincette_supervisor.journal.access_rows import KeyRepository
from pincette_supervisor.journal.database import columns
from pincette_supervisor.journal.key_file import KeyFile, KeyNameTakenError, KeyRow
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.journal.tables import utc_text


class KeyStore:
    """The keys in a data folder."""

    def __init__(self, repository: KeyRepository | KeyFile) -> None:
        self._repository = repository

    def add(self, name: str, scope: Scope, days: float | None) -> tuple[str, KeyView]:
        """Make a key, which is shown this once.

        Raises ValueError where the name is taken, and for a key with an end where the time of day
        is behind the latest time that a supervisor has seen.
        """
        key, expires_at, now = new_key(), None, utc()
        if days is not None:
            latest = self._repository.latest_at()
            if latest is not None and latest - now > BEHIND:
                raise ValueError(
                    f"the time of day is {utc_text(now)}, and the supervisor has seen "
                    f"{utc_text(latest)}: set the clock of this machine, or if it is right "
                    f"acknowledge the alarm {KEY_CLOCK!r}; a key without --days is not concerned"
                )
            expires_at = utc_text(now + timedelta(days=days))
        try:
            row = self._repository.add(name, digest_of(key), scope, expires_at)
        except KeyNameTakenError as error:
            raise ValueError(
                f"there is, or was, a key {name!r}: the audit log names it; take another name"
            ) from error
        return key, self._view(row)

    def add_user(self, name: str, scope: Scope, password: str) -> KeyView:
        """Keep a person who signs in by name and password; raises ValueError as ``add``."""
        try:
            # Of a key that nobody has been told.
            row = self._repository.add(name, digest_of(new_key()), scope, password=hashed(password))
        except KeyNameTakenError as error:
            raise ValueError(
                f"there is, or was, a user or a key {name!r}: take another name"
            ) from error
        return self._view(row)

    def set_password(self, name: str, password: str) -> bool:
        """Give a user another password; false where there is no such user in force."""
        return self._repository.set_password(name, hashed(password))

    def all(self, *, users: bool = False) -> list[KeyView]:
        """Every key there is or was; or every user."""
        rows = self._repository.all()
        return [self._view(row) for row in rows if (row.password is not None) == users]

    def revoke(self, name: str) -> bool:
        """Take a key out of force; false where there is none to be."""
        return self._repository.revoke(name)

    def _view(self, row: KeyRow) -> KeyView:
        """A key as it is shown, judged by the latest time as a supervisor does."""
        now = utc()
        latest = max(now, self._repository.latest_at() or now)
        return KeyView(**columns(row, "digest", "password"), usable=row.usable(utc_text(latest)))


@contextmanager
def open_keys(data: Path) -> Generator[KeyStore]:
    """Open the keys of a data folder, which is made where there is none; raises StoreError."""
    try:
        store = Store(data / STORE, os.environ.get(STORE_URL, ""))
    except StoreError:
        file = KeyFile(data)
        if file.read() is None:  # the keys may be in that journal alone
            raise
        yield KeyStore(file)  # a damaged journal keeps nobody from revoking a key
        return
    with closing(store):
        yield KeyStore(KeyRepository(store))
