"""Keys, signed-in pages and the audit log, as the journal keeps them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from hashlib import sha256

from sqlalchemy import delete, func, insert, select, update

from pincette.api.access import Scope
from pincette_supervisor.journal.database import Database, columns
from pincette_supervisor.journal.engines import insert_of
from pincette_supervisor.journal.key_file import KeyFile, KeyRow
from pincette_supervisor.journal.tables import AUDIT, KEYS, SESSIONS

AUDIT_KEPT = 200_000
"""Number of the newest audit entries, which the journal refuses to delete."""
AUDIT_SWEEP = 1000
"""Number of further entries after which the oldest are deleted."""
CHAIN_ROWS = 5000
"""Entries that are read at a time where the chain is followed."""
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

    def add(
        self,
        name: str,
        digest: str,
        scope: Scope,
        expires_at: str | None = None,
        password: str | None = None,
    ) -> KeyRow:
        """Keep a key; raises KeyNameTakenError: what the audit log names stays the same key."""
        self.all()
        row = self._file.add(name, digest, scope, expires_at, password)
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
                put = insert_of(connection, KEYS).values(values)
                connection.execute(put.on_conflict_do_update(index_elements=["name"], set_=values))
        self._copied = rows

    def latest_at(self) -> datetime | None:
        """Return the latest time that a supervisor has noted; None before the first."""
        return self._file.latest_at()

    def note_latest(self, latest_at: datetime) -> None:
        """Keep the latest time that was seen."""
        self._file.note_latest(latest_at)

    def revoke(self, name: str) -> bool:
        """Take a key out of force and end its sessions; false where there is none to be."""
        self.all()
        revoked = self._file.revoke(name)
        self.copy(self.all())
        return revoked

    def set_password(self, name: str, password: str) -> bool:
        """Give a user another password, and sign the user out everywhere."""
        self.all()
        changed = self._file.set_password(name, password)
        if changed:
            with self._store.writing() as connection:
                connection.execute(delete(SESSIONS).where(SESSIONS.c.key == name))
            self.copy(self.all())
        return changed

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

    def sign_out(self, *digests: str) -> None:
        """End sessions."""
        with self._store.writing() as connection:
            connection.execute(delete(SESSIONS).where(SESSIONS.c.digest.in_(digests)))

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
    """Rises by one with every entry; None until it is kept."""
    link: str = ""
    """Of the chain: SHA-256 of the entry and of the link before it, in hex."""

    def linked(self, number: int, before: str) -> "AuditRow":
        """The same entry, in its place behind a link."""
        row = replace(self, number=number, link="")
        values = json.dumps([before, *asdict(row).values()], separators=(",", ":"))
        return replace(row, link=sha256(values.encode()).hexdigest())


@dataclass(frozen=True, slots=True)
class AuditChain:
    """What the chain of the audit log shows."""

    entries: int
    first: int | None
    """Number of the oldest entry that is kept; it stands for those before it."""
    newest: AuditRow | None
    broken: int | None
    """Number of the first entry that does not follow from the one before it; None: all do."""
    found: bool
    """Whether a link that was asked for is one of the log's."""


class AuditRepository:
    """The audit log of a journal."""

    def __init__(self, store: Database) -> None:
        self._store = store

    def add(self, rows: Sequence[AuditRow]) -> None:
        """Keep entries, in order."""
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
        """Follow the chain from its oldest entry on, and look for a link that was noted before."""
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
        """Entries, the newest first; those before a number, where one is named."""
        query = select(AUDIT).order_by(AUDIT.c.number.desc()).limit(limit)
        if before is not None:
            query = query.where(AUDIT.c.number < before)
        return self._store.rows(AuditRow, query)
