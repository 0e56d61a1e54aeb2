"""Stored keys of the REST interface, sessions of signed-in pages, and the audit log.

The key file is the only place where keys are kept.
"""

import fcntl
import json
import os
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any

from pydantic import AwareDatetime, BaseModel, ConfigDict, StringConstraints, ValidationError
from sqlalchemy import delete, func, insert, select, update

from pincette.api.access import Scope
from pincette.core.files import decoded, replace_file
from pincette.core.validation_wording import refusal
from pincette_supervisor.journal.database import (
    KEY_FILE,
    SEE_DISK,
    USE_LOCAL_DISK,
    Database,
    StoreError,
    columns,
)
from pincette_supervisor.journal.tables import AUDIT, SESSIONS, utc_now, utc_text

KEYS_WANTED = "keys_wanted"
"""Name of the journal's note which states that the data folder has had keys. With this note, a
missing key file does not give everyone access.
"""


class KeyNameTakenError(Exception):
    """Error raised if there is, or was, a key of this name."""


@dataclass(frozen=True, slots=True)
class KeyRow:
    """A key, without its secret, or a user: name, scope, and its times in UTC."""

    name: str
    digest: Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]
    scope: Scope
    made_at: str
    expires_at: str | None = None
    revoked_at: str | None = None
    used_at: str | None = None
    password: str | None = None
    """Password hash of a user, see ``access.passwords``; None for a key. The digest of a user is
    that of a random key that is not shown.
    """

    def usable(self, now: str) -> bool:
        """Return whether the key is valid at a time."""
        return self.revoked_at is None and (self.expires_at is None or now < self.expires_at)


class _Content(BaseModel):
    """Content of the key file; an unknown or missing member means that the file is damaged."""

    model_config = ConfigDict(extra="forbid", strict=True)
    version: int
    keys: list[KeyRow]
    latest_at: AwareDatetime | None = None
    """Latest time that a supervisor has seen; expiry of keys is judged by it if the clock is
    behind.
    """


class KeyFile:
    """The keys of a data folder, readable only by their owner; raises StoreError."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / KEY_FILE

    def read(self) -> list[KeyRow]:
        """Return all keys by name, including revoked ones; an empty list without a file."""
        content = self._content()
        return [] if content is None else sorted(content.keys, key=lambda row: row.name)

    def latest_at(self) -> datetime | None:
        """Return the latest time that a supervisor has stored; None before the first."""
        content = self._content()
        return None if content is None else content.latest_at

    def _content(self) -> _Content | None:
        try:
            content = _Content.model_validate_json(decoded(self._path.read_bytes()))
            if content.version != 1:
                raise ValueError(f"its version is {content.version}, this program knows 1")
        except FileNotFoundError:
            return None
        except ValidationError as error:
            raise self._damaged(refusal(error.errors(include_url=False)[0])) from error
        except OSError as error:
            raise StoreError(
                f"the key file {self._path} cannot be read: {error.strerror}; check the disk "
                f"and its permissions. If it is a network share, {USE_LOCAL_DISK}"
            ) from error
        except ValueError as error:
            raise self._damaged(str(error)) from error
        return content

    def add(
        self,
        name: str,
        digest: str,
        scope: Scope,
        expires_at: str | None = None,
        password: str | None = None,
    ) -> KeyRow:
        """Store a key; raises KeyNameTakenError, since names in the audit log must stay unique."""
        row = KeyRow(name, digest, scope, utc_now(), expires_at, password=password)
        with self._changed() as keys:
            if name in keys:
                raise KeyNameTakenError(name)
            keys[name] = row
        return row

    def revoke(self, name: str) -> bool:
        """Revoke a key; return False if there is no valid one."""
        with self._changed() as keys:
            row = keys.get(name)
            if row is None or row.revoked_at is not None:
                return False
            keys[name] = replace(row, revoked_at=utc_now())
        return True

    def set_password(self, name: str, password: str, digest: str) -> bool:
        """Set a user's password and a new digest, which ends the user's sessions.

        Return False if there is no user of this name, or if the user was removed.
        """
        with self._changed() as keys:
            row = keys.get(name)
            if row is None or row.revoked_at is not None or row.password is None:
                return False
            keys[name] = replace(row, password=password, digest=digest)
        return True

    def note_use(self, used_at: dict[str, str]) -> None:
        """Store when keys, by name, were last used."""
        with self._changed() as keys:
            for name in used_at.keys() & keys.keys():
                keys[name] = replace(keys[name], used_at=used_at[name])

    def note_latest(self, latest_at: datetime) -> None:
        """Store the latest time that was seen; has no effect without a file."""
        with self._changed(latest_at):
            pass

    @contextmanager
    def _changed(self, latest_at: datetime | None = None) -> Generator[dict[str, KeyRow]]:
        """Yield the keys by name for changes, then write them with the time; locks out other
        programs.
        """
        try:
            folder = os.open(self._path.parent, os.O_RDONLY)
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            try:
                fcntl.flock(folder, fcntl.LOCK_EX)
            except OSError as error:
                raise StoreError(
                    f"the key file {self._path} cannot be locked: {error.strerror}; its file "
                    f"system has no locks: {USE_LOCAL_DISK}. No key was changed"
                ) from error
            content = self._content() or _Content(version=1, keys=[])
            before = {row.name: row for row in content.keys}
            keys = dict(before)
            yield keys
            if keys and (keys != before or latest_at is not None):
                self._write(list(keys.values()), latest_at or content.latest_at)
        finally:
            os.close(folder)

    def _write(self, rows: Sequence[KeyRow], latest_at: datetime | None) -> None:
        """Replace the whole file; another program reads the old one or the new one."""
        content: dict[str, Any] = {"version": 1, "keys": [asdict(row) for row in rows]}
        if latest_at is not None:
            content["latest_at"] = utc_text(latest_at)
        text = json.dumps(content, indent=1)
        try:
            replace_file(self._path, text.encode() + b"\n", 0o600)
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> StoreError:
        return StoreError(
            f"the key file {self._path} cannot be written: {error.strerror}; {SEE_DISK}"
        )

    def _damaged(self, why: str) -> StoreError:
        return StoreError(
            f"the key file {self._path} cannot be used: {why}; restore it from a backup, or "
            f"move it away and {self._make_one}"
        )

    def missing(self) -> StoreError:
        """Return the error to raise if keys are required and the file has none."""
        return StoreError(
            f"the key file {self._path} is missing or has no keys, and this supervisor has "
            f"had keys: restore it from a backup, or {self._make_one}"
        )

    @property
    def _make_one(self) -> str:
        folder = self._path.parent
        return f"make a new key: `pincette key add NAME --scope admin --data {folder}`"


AUDIT_KEPT = 200_000
"""Number of the newest audit entries, which the journal does not permit to delete."""
AUDIT_SWEEP = 1000
"""Number of further entries after which the oldest are deleted."""
CHAIN_ROWS = 5000
"""Number of entries that are read at once when the chain is checked."""
SESSIONS_MAX = 200
"""Largest number of signed-in pages; a new one replaces the least recently used."""


@dataclass(frozen=True, slots=True)
class SessionRow:
    """Session of a page that was signed in with a key, or by a user."""

    digest: str
    """SHA-256 of the cookie."""
    key: str
    """Digest of the key. A user's digest changes with the password."""
    used_at: str


class SessionRepository:
    """The sessions of a journal."""

    def __init__(self, store: Database) -> None:
        self._store = store

    def all(self) -> list[SessionRow]:
        """Return all sessions."""
        return self._store.rows(SessionRow, select(SESSIONS))

    def sign_in(self, session: SessionRow) -> None:
        """Add a session; if there are too many, delete those that were used least recently."""
        with self._store.writing() as connection:
            newest = select(SESSIONS.c.digest).order_by(SESSIONS.c.used_at.desc())
            kept = newest.limit(SESSIONS_MAX - 1)
            connection.execute(delete(SESSIONS).where(SESSIONS.c.digest.not_in(kept)))
            connection.execute(insert(SESSIONS).values(columns(session)))

    def sign_out(self, *digests: str) -> None:
        """Delete sessions."""
        with self._store.writing() as connection:
            connection.execute(delete(SESSIONS).where(SESSIONS.c.digest.in_(digests)))

    def note_use(self, used_at: Mapping[str, str]) -> None:
        """Store when sessions, by digest, were last used."""
        with self._store.writing() as connection:
            for digest, at in used_at.items():
                seen = update(SESSIONS).where(SESSIONS.c.digest == digest)
                connection.execute(seen.values(used_at=at))


@dataclass(frozen=True, slots=True)
class AuditRow:
    """A request, its caller, and the result."""

    at: str
    who: str
    address: str
    action: str
    detail: str
    status: int
    count: int = 1
    number: int | None = None
    """Number of the entry, rising by one with each; None until it is stored."""
    link: str = ""
    """Link of the chain: SHA-256 of the entry and of the link before it, in hex."""

    def linked(self, number: int, before: str) -> "AuditRow":
        """Return the same entry, linked to the one before it."""
        row = replace(self, number=number, link="")
        values = json.dumps([before, *asdict(row).values()], separators=(",", ":"))
        return replace(row, link=sha256(values.encode()).hexdigest())


@dataclass(frozen=True, slots=True)
class AuditChain:
    """Result of checking the chain of the audit log."""

    entries: int
    first: int | None
    """Number of the oldest stored entry; those before it have been deleted."""
    newest: AuditRow | None
    broken: int | None
    """Number of the first entry that does not follow from the one before it; None: all do."""
    found: bool
    """True if the requested link is in the log."""


class AuditRepository:
    """The audit log of a journal."""

    def __init__(self, store: Database) -> None:
        self._store = store

    def add(self, rows: Sequence[AuditRow]) -> None:
        """Store entries, in order."""
        if not rows:
            return
        with self._store.writing() as connection:
            newest, link = connection.execute(
                select(AUDIT.c.number, AUDIT.c.link).order_by(AUDIT.c.number.desc()).limit(1)
            ).one_or_none() or (0, "")
            for row in rows:
                row = row.linked(newest + 1, link)
                newest, link = newest + 1, row.link
                connection.execute(insert(AUDIT).values(columns(row)))
            oldest = connection.execute(select(func.min(AUDIT.c.number))).scalar_one()
            if newest - oldest >= AUDIT_KEPT + AUDIT_SWEEP:
                connection.execute(delete(AUDIT).where(AUDIT.c.number <= newest - AUDIT_KEPT))

    def chain(self, wanted: str = "") -> AuditChain:
        """Check the chain from its oldest entry, and search it for the link ``wanted``."""
        before: AuditRow | None = None
        entries, first, broken, found = 0, None, None, not wanted
        while rows := self._after(before):
            for row in rows:
                if before is None:
                    first = row.number
                elif broken is None and row != row.linked((before.number or 0) + 1, before.link):
                    broken = row.number
                found = found or row.link == wanted
                before, entries = row, entries + 1
        return AuditChain(entries, first, before, broken, found)

    def _after(self, row: AuditRow | None) -> list[AuditRow]:
        query = select(AUDIT).order_by(AUDIT.c.number).limit(CHAIN_ROWS)
        if row is not None:
            query = query.where(AUDIT.c.number > row.number)
        return self._store.rows(AuditRow, query)

    def newest(self, limit: int, before: int | None = None) -> list[AuditRow]:
        """Return entries, newest first; only those with a number below ``before``, if it is
        given.
        """
        query = select(AUDIT).order_by(AUDIT.c.number.desc()).limit(limit)
        if before is not None:
            query = query.where(AUDIT.c.number < before)
        return self._store.rows(AuditRow, query)
