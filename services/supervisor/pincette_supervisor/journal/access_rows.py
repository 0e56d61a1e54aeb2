"""Keys, signed-in pages and the audit log, as the journal keeps them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from sqlalchemy import delete, func, select, update
from sqlalchemy.dialects.sqlite import insert

from pincette.api.access import Scope
from pincette_supervisor.journal.database import Database, columns
from pincette_supervisor.journal.key_file import KeyFile, KeyRow
from pincette_supervisor.journal.tables import AUDIT, KEYS, SESSIONS

AUDIT_KEPT = 200_000
"""Entries that are kept at least; the file refuses to lose one of them."""
AUDIT_SWEEP = 1000
"""How far beyond it may grow before the oldest go."""
SESSIONS_MAX = 200
"""Signed-in pages; the one that was seen least lately makes room for another."""


@dataclass(frozen=True, slots=True)
class SessionRow:
    """A page that was signed in with a key."""

    digest: str
    key: str
    used_at: str


class KeyRepository:
    """The keys of a data folder, and the sessions of its journal.

    The key file decides. The journal has a copy, from which a lost file is written again, and from
    which the file is made where an earlier version kept the keys in the journal alone.
    """

    def __init__(self, store: Database) -> None:
        self._store, self._file = store, KeyFile(store.folder)
        self._copied: list[KeyRow] | None = None
        """What the journal's copy holds; None before it was looked at."""

    def add(self, name: str, digest: str, scope: Scope, expires_at: str | None = None) -> KeyRow:
        """Keep a key; raises KeyNameTakenError: what the audit log names stays the same key."""
        self.all()
        row = self._file.add(name, digest, scope, expires_at)
        self.copy(self.all())
        return row

    def all(self) -> list[KeyRow]:
        """Every key there is or was, by name; a lost file is written again."""
        rows = self._file.read()
        if rows is not None:
            return rows
        known = self._store.rows(KeyRow, select(KEYS).order_by(KEYS.c.name))
        if known:
            self._file.restore(known)
        return self._file.all()

    def copy(self, rows: list[KeyRow]) -> None:
        """Let the journal's copy hold these keys, and end the sessions of those revoked."""
        if rows == self._copied:
            return
        names = [row.name for row in rows if row.revoked_at is None]
        with self._store.writing() as connection:
            connection.execute(delete(SESSIONS).where(SESSIONS.c.key.not_in(names)))
            connection.execute(delete(KEYS).where(KEYS.c.name.not_in([row.name for row in rows])))
            for row in rows:
                values = asdict(row)
                put = insert(KEYS).values(values)
                connection.execute(put.on_conflict_do_update(index_elements=["name"], set_=values))
        self._copied = rows

    def revoke(self, name: str) -> bool:
        """Take a key out of force and end its sessions; false where there is none to be."""
        self.all()
        revoked = self._file.revoke(name)
        self.copy(self.all())
        return revoked

    def sessions(self) -> list[SessionRow]:
        """Pages that are signed in."""
        return self._store.rows(SessionRow, select(SESSIONS))

    def sign_in(self, digest: str, key: str, at: str) -> None:
        """Keep a session that begins at a time."""
        with self._store.writing() as connection:
            newest = select(SESSIONS.c.digest).order_by(SESSIONS.c.used_at.desc())
            kept = newest.limit(SESSIONS_MAX - 1)
            connection.execute(delete(SESSIONS).where(SESSIONS.c.digest.not_in(kept)))
            connection.execute(insert(SESSIONS).values(digest=digest, key=key, used_at=at))

    def sign_out(self, digest: str) -> None:
        """End a session."""
        with self._store.writing() as connection:
            connection.execute(delete(SESSIONS).where(SESSIONS.c.digest == digest))

    def note_use(self, keys: Mapping[str, str], sessions: Mapping[str, str]) -> None:
        """Keep when keys, by name, and sessions, by digest, were last used."""
        self._file.note_use(dict(keys))
        with self._store.writing() as connection:
            for digest, at in sessions.items():
                seen = update(SESSIONS).where(SESSIONS.c.digest == digest)
                connection.execute(seen.values(used_at=at))


@dataclass(frozen=True, slots=True)
class AuditRow:
    """A request, whose it was, and what came of it."""

    at: str
    who: str
    address: str
    action: str
    detail: str
    status: int
    count: int = 1
    number: int | None = None
    """Rises with every entry; None until it is kept."""


class AuditRepository:
    """The audit log of a journal."""

    def __init__(self, store: Database) -> None:
        self._store = store

    def add(self, rows: Sequence[AuditRow]) -> None:
        """Keep entries, in order."""
        if not rows:
            return
        with self._store.writing() as connection:
            connection.execute(insert(AUDIT), [columns(row, "number") for row in rows])
            oldest, newest = connection.execute(
                select(func.min(AUDIT.c.number), func.max(AUDIT.c.number))
            ).one()
            if newest - oldest >= AUDIT_KEPT + AUDIT_SWEEP:
                connection.execute(delete(AUDIT).where(AUDIT.c.number <= newest - AUDIT_KEPT))

    def newest(self, limit: int, before: int | None = None) -> list[AuditRow]:
        """Entries, the newest first; those before a number, where one is named."""
        query = select(AUDIT).order_by(AUDIT.c.number.desc()).limit(limit)
        if before is not None:
            query = query.where(AUDIT.c.number < before)
        return self._store.rows(AuditRow, query)
