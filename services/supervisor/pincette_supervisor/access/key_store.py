"""Keys of a data folder for the command line, with or without a running supervisor."""

import os
from collections.abc import Generator
from contextlib import closing, contextmanager, suppress
from datetime import timedelta
from pathlib import Path

from pincette.api.access import KeyView, Scope
from pincette.core.files import make_folder
from pincette.security.latest_time import utc
from pincette_supervisor.access.access import BEHIND, KEY_CLOCK
from pincette_supervisor.access.authentication import digest_of, new_key
from pincette_supervisor.access.passwords import hashed
from pincette_supervisor.config import STORE, STORE_URL
from pincette_supervisor.journal.access import KEYS_WANTED, KeyFile, KeyNameTakenError, KeyRow
from pincette_supervisor.journal.database import columns
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.journal.tables import utc_text


class KeyStore:
    """Store of the keys in a data folder."""

    def __init__(self, file: KeyFile, journal: Store | StoreError) -> None:
        """Create the store of a key file.

        ``journal`` is the error of a journal that cannot be used, since keys do not depend on it.
        """
        self._file, self._journal = file, journal

    def add(self, name: str, scope: Scope, days: float | None) -> tuple[str, KeyView]:
        """Make a key, which is shown this once.

        Raises ValueError if the name is taken, or if the key is to expire and the time of day is
        behind the latest time that a supervisor has seen.
        """
        key, expires_at, now = new_key(), None, utc()
        if days is not None:
            latest = self._file.latest_at()
            if latest is not None and latest - now > BEHIND:
                raise ValueError(
                    f"the time of day is {utc_text(now)}, and the supervisor has seen "
                    f"{utc_text(latest)}: set the clock of this machine, or if it is right "
                    f"acknowledge the alarm {KEY_CLOCK!r}; keys made without --days are not "
                    "affected"
                )
            expires_at = utc_text(now + timedelta(days=days))
        try:
            row = self._file.add(name, digest_of(key), scope, expires_at)
        except KeyNameTakenError as error:
            raise ValueError(
                f"there is, or was, a key {name!r}: the audit log names it; take another name"
            ) from error
        return key, self._noted(row)

    def add_user(self, name: str, scope: Scope, password: str) -> KeyView:
        """Add a person who signs in by name and password; raises ValueError like ``add``."""
        try:
            # The digest of a random key that is not shown, so it cannot be used.
            digest = digest_of(new_key())
            row = self._file.add(name, digest, scope, password=hashed(password))
        except KeyNameTakenError as error:
            raise ValueError(
                f"there is, or was, a user or a key {name!r}: take another name"
            ) from error
        return self._noted(row)

    def _noted(self, row: KeyRow) -> KeyView:
        """Record in the journal that keys are required; return the key for display."""
        if isinstance(self._journal, Store):
            with suppress(StoreError):  # the supervisor writes this note when it reads the key
                self._journal.set_note(KEYS_WANTED, "1")
        return self._view(row)

    def set_password(self, name: str, password: str) -> bool:
        """Set a user's password and end the user's sessions; return False for an unknown user.

        The sessions end because they refer to the digest of the user, which is replaced.
        """
        return self._file.set_password(name, hashed(password), digest_of(new_key()))

    def all(self, *, users: bool = False) -> list[KeyView]:
        """Return all keys, or all users, including revoked ones.

        Raises StoreError if there are no keys although there have been some, or may have been.
        """
        rows = self._file.read()
        if not rows:
            if isinstance(self._journal, StoreError):
                raise StoreError(
                    "no key in the key file, and it is not known whether there were any: "
                    f"{self._journal}"
                ) from self._journal
            if self._journal.get_note(KEYS_WANTED) is not None:
                raise self._file.missing()
        return [self._view(row) for row in rows if (row.password is not None) == users]

    def revoke(self, name: str) -> bool:
        """Revoke a key; return False if no valid key has this name."""
        return self._file.revoke(name)

    def _view(self, row: KeyRow) -> KeyView:
        """Return a key for display.

        Its expiry is judged by the latest time, as in a supervisor.
        """
        now = utc()
        latest = max(now, self._file.latest_at() or now)
        return KeyView(**columns(row, "digest", "password"), usable=row.usable(utc_text(latest)))


@contextmanager
def open_keys(data: Path) -> Generator[KeyStore]:
    """Open the keys of a data folder, which is created if it does not exist.

    Keys can be added and revoked even if the journal is unusable. Methods of the store raise
    StoreError if the key file is unusable.
    """
    make_folder(data)
    try:
        journal = Store(data / STORE, os.environ.get(STORE_URL, ""))
    except StoreError as error:
        yield KeyStore(KeyFile(data), error)
        return
    with closing(journal):
        yield KeyStore(KeyFile(data), journal)
