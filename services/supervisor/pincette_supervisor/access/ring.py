"""The keys and sessions in force, as one picture in memory: who is asked waits for no disk."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from pincette_supervisor.access.secret import LONGEST, digest_of, same
from pincette_supervisor.journal.keys import KeyRow, SessionRow

IDLE_H = 12.0
"""A session ends when its page has not asked for so long; an open page asks every second."""


@dataclass(frozen=True, slots=True)
class Ring:
    """Keys and sessions as they were when the journal was last looked at."""

    keys: Sequence[KeyRow] = ()
    sessions: Sequence[SessionRow] = ()

    def key(self, text: str, now: str) -> KeyRow | None:
        """The key that a caller has shown; None where it opens nothing at that time."""
        if len(text) > LONGEST:
            return None
        digest, found = digest_of(text), None
        for row in self.keys:  # all of them, so that the time tells nothing
            if same(row.digest, digest):
                found = row
        return found if found is not None and found.usable(now) else None

    def session(self, cookie: str, now: str) -> tuple[SessionRow, KeyRow] | None:
        """The session of a cookie and its key; None where either opens nothing at that time."""
        if len(cookie) > LONGEST:
            return None
        digest, found = digest_of(cookie), None
        for row in self.sessions:
            if same(row.digest, digest):
                found = row
        if found is None or found.used_at < before(now, IDLE_H):
            return None
        for key in self.keys:
            if key.name == found.key and key.usable(now):
                return found, key
        return None


def before(now: str, hours: float) -> str:
    """A time in UTC, as the journal writes it, some hours before another."""
    time = datetime.fromisoformat(now) - timedelta(hours=hours)
    return time.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
