"""Keys of the REST interface, and pages signed in with them, as they are kept."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from sqlalchemy import delete, insert, select, update

from pincette.api.access_models import Scope
from pincette_supervisor.journal.base import Base
from pincette_supervisor.journal.rows import utc_now
from pincette_supervisor.journal.tables import KEYS, SESSIONS

SESSIONS_MAX = 200
"""Signed-in pages; the one that was seen least lately makes room for another."""


class KeyNameTakenError(Exception):
    """There is, or was, a key of this name."""


@dataclass(frozen=True, slots=True)
class KeyRow:
    """A key without itself: its name, what it may, and its times in UTC."""

    name: str
    digest: str
    scope: Scope
    made_at: str
    expires_at: str | None = None
    revoked_at: str | None = None
    used_at: str | None = None

    def usable(self, now: str) -> bool:
        """Whether it opens anything at a time."""
        return self.revoked_at is None and (self.expires_at is None or now < self.expires_at)


@dataclass(frozen=True, slots=True)
class SessionRow:
    """A page that was signed in with a key."""

    digest: str
    key: str
    used_at: str


class KeyBook:
    """The keys of a journal."""

    def __init__(self, store: Base) -> None:
        self._store = store

    def add(self, name: str, digest: str, scope: Scope, expires_at: str | None = None) -> KeyRow:
        """Keep a key; raises KeyNameTakenError: what the audit log names stays the same key."""
        row = KeyRow(name, digest, scope, utc_now(), expires_at)
        with self._store.writing() as base:
            if base.scalar(select(KEYS.c.name).where(KEYS.c.name == name)) is not None:
                raise KeyNameTakenError(name)
            base.execute(
                insert(KEYS).values(
                    name=name,
                    digest=digest,
                    scope=scope,
                    made_at=row.made_at,
                    expires_at=expires_at,
                )
            )
        return row

    def all(self) -> list[KeyRow]:
        """Every key there is or was, by name."""
        with self._store.reading() as base:
            rows = base.execute(select(KEYS).order_by(KEYS.c.name)).mappings()
            return [KeyRow(**cast(Any, dict(row))) for row in rows]

    def revoke(self, name: str) -> bool:
        """Take a key out of force and end its sessions; false where there is none to be."""
        inforce = (KEYS.c.name == name) & KEYS.c.revoked_at.is_(None)
        with self._store.writing() as base:
            base.execute(delete(SESSIONS).where(SESSIONS.c.key == name))
            return (
                base.execute(update(KEYS).where(inforce).values(revoked_at=utc_now())).rowcount > 0
            )

    def sessions(self) -> list[SessionRow]:
        """Pages that are signed in."""
        with self._store.reading() as base:
            return [
                SessionRow(**cast(Any, dict(row)))
                for row in base.execute(select(SESSIONS)).mappings()
            ]

    def sign_in(self, digest: str, key: str, at: str) -> None:
        """Keep a session that begins at a time."""
        with self._store.writing() as base:
            newest = select(SESSIONS.c.digest).order_by(SESSIONS.c.used_at.desc())
            kept = newest.limit(SESSIONS_MAX - 1)
            base.execute(delete(SESSIONS).where(SESSIONS.c.digest.not_in(kept)))
            base.execute(insert(SESSIONS).values(digest=digest, key=key, used_at=at))

    def sign_out(self, digest: str) -> None:
        """End a session."""
        with self._store.writing() as base:
            base.execute(delete(SESSIONS).where(SESSIONS.c.digest == digest))

    def note_use(self, keys: Mapping[str, str], sessions: Mapping[str, str]) -> None:
        """Keep when keys, by name, and sessions, by digest, were last used."""
        with self._store.writing() as base:
            for name, at in keys.items():
                base.execute(update(KEYS).where(KEYS.c.name == name).values(used_at=at))
            for digest, at in sessions.items():
                seen = update(SESSIONS).where(SESSIONS.c.digest == digest)
                base.execute(seen.values(used_at=at))
