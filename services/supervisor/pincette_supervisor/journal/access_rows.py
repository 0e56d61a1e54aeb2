"""Sessions of signed-in pages and the audit log, as the journal keeps them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256

from sqlalchemy import delete, func, insert, select, update

from pincette_supervisor.journal.database import Database, columns
from pincette_supervisor.journal.tables import AUDIT, SESSIONS

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
        """Add a session; the one that was used least recently may make room for it."""
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
    """Rises by one with every entry; None until it is kept."""
    link: str = ""
    """Link of the chain: SHA-256 of the entry and of the link before it, in hex."""

    def linked(self, number: int, before: str) -> "AuditRow":
        """Return the same entry, in its place behind a link."""
        row = replace(self, number=number, link="")
        values = json.dumps([before, *asdict(row).values()], separators=(",", ":"))
        return replace(row, link=sha256(values.encode()).hexdigest())


@dataclass(frozen=True, slots=True)
class AuditChain:
    """Result of checking the chain of the audit log."""

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
        """Return entries, the newest first; those before a number, where one is named."""
        query = select(AUDIT).order_by(AUDIT.c.number.desc()).limit(limit)
        if before is not None:
            query = query.where(AUDIT.c.number < before)
        return self._store.rows(AuditRow, query)
