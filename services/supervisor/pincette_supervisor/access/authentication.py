"""Authentication of callers by key or session, and the check of their scope."""

import hashlib
import hmac
import secrets
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache
from ipaddress import IPv6Address, IPv6Network
from typing import Literal, TypeVar

from pincette.api.access import MEANINGS, SCOPES, Scope, covers
from pincette.security.latest_time import LatestTime, since_boot_s, utc
from pincette_supervisor.access.passwords import PasswordCheck
from pincette_supervisor.journal.access import (
    KEYS_WANTED,
    SESSIONS_MAX,
    KeyFile,
    KeyRow,
    SessionRepository,
    SessionRow,
)
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import utc_text
from pincette_supervisor.journal.write_queue import WriteQueue
from pincette_supervisor.problems import ProblemError

REALM = 'Bearer realm="pincette"'
IDLE_H = 12.0
"""Time in h without a request after which a session ends; an open page sends one every second."""
HOUR = len("2026-01-01T00")
"""Number of characters of a time down to its hour."""
UNCONFIRMED_S = 15.0
"""Longest time without a successful reading of the keys after which they are still accepted, in
s."""
BYTES = 32
# 256 random bits cannot be guessed, so a plain SHA-256 is stored: a slow hash protects passwords
# that people choose, and would make a flood of wrong keys expensive.
PREFIX = "pincette_"
"""Prefix by which a key that was published by mistake can be found and recognised."""
LONGEST = 200
"""Number of characters of the longest key or cookie that is examined."""
R = TypeVar("R", KeyRow, SessionRow)


def new_key() -> str:
    """Make a key; it is shown once and never stored."""
    return PREFIX + secrets.token_urlsafe(BYTES)


def new_cookie() -> str:
    """Make the cookie of a signed-in page."""
    return secrets.token_urlsafe(BYTES)


def digest_of(secret: str) -> str:
    """Return the SHA-256 of a key or cookie in hexadecimal digits; only this digest is stored."""
    return hashlib.sha256(secret.encode(errors="replace")).hexdigest()


def _found(rows: Sequence[R], secret: str) -> R | None:
    """Return the row whose digest is that of a secret."""
    if len(secret) > LONGEST:
        return None
    digest, found = digest_of(secret), None
    for row in rows:  # compare all rows, so that the duration reveals nothing
        if hmac.compare_digest(row.digest, digest):
            found = row
    return found


@lru_cache(maxsize=256)
def network_of(address: str) -> str:
    """Return the 64-bit network of an IPv6 address; any other address unchanged."""
    try:
        known = IPv6Address(address)
    except ValueError:
        return address
    return str(IPv6Network((int(known) >> 64 << 64, 64)))


@dataclass(frozen=True, slots=True)
class Caller:
    """A caller, with its address and rights."""

    address: str
    name: str | None = None
    """Name of the caller's key; None if no keys are in force or no valid one was sent."""
    scope: Scope | None = None
    """Scope of the caller; None: nothing is allowed."""
    way: Literal["open", "key", "session", "none"] = "none"
    showed: bool = False
    """True if a key or a cookie was sent, valid or not."""
    unconfirmed: bool = False
    """True if the caller is rejected because the supervisor cannot read its keys."""
    digest: str = ""
    """Digest of the key or user to which a session refers; empty if none is in force."""

    @property
    def network(self) -> str:
        """Return the address that identifies a client: for IPv6, its 64-bit network."""
        return network_of(self.address)

    @property
    def client(self) -> str:
        """Return the client whose limits a request uses up: a key, otherwise an address."""
        return self.name or self.network

    def signed(self, label: str) -> str:
        """Return the name stored with an action: key and label, or the label if there are no
        keys."""
        if self.name is None:
            return (label if self.way == "open" else "") or self.address
        return f"{self.name} ({label})" if label else self.name


@dataclass(frozen=True, slots=True)
class KeySnapshot:
    """Keys and sessions at the time they were last read."""

    keys: Sequence[KeyRow] = ()
    sessions: Sequence[SessionRow] = ()

    def key(self, text: str, now: str) -> KeyRow | None:
        """Return the key that a caller sent; None if it is not valid at that time."""
        found = _found(self.keys, text)
        return found if found is not None and found.usable(now) else None

    def session(self, cookie: str, now: str) -> tuple[SessionRow, KeyRow] | None:
        """Return the session of a cookie and its key; None if the key is not valid at that time."""
        found = _found(self.sessions, cookie)
        if found is None:
            return None
        for key in self.keys:
            if key.digest == found.key and key.usable(now):
                return found, key
        return None


class Authenticator:
    """Identifies callers by the keys and sessions in memory, so that no stop waits for the disk."""

    # Keys are required as soon as one exists or has existed: after the last one is revoked all
    # requests are refused. The key file and its snapshot in memory decide. The journal is used only
    # for the note by which a missing key file is recognised.

    def __init__(
        self,
        *,
        always: bool = False,
        supervisor: str = "",
        wall: Callable[[], datetime] = utc,
        clock: Callable[[], float] = since_boot_s,
    ) -> None:
        """Create the authenticator.

        ``wall`` is the time of day, ``clock`` a monotonic time in s.
        """
        self._always, self._clock = always, clock
        self._had_keys = False
        """True if this data folder has, or had, keys."""
        self._had_keys_noted = False
        """True once the journal contains the note that there were keys."""
        self.time = LatestTime(wall, clock)
        """Time used to judge the expiry of keys; never goes back."""
        self._noted: tuple[str, frozenset[str]] | None = None
        """Hour, and names of the valid keys, when the latest time was last stored; None before
        that.
        """
        self.supervisor = supervisor
        """Identifier of the supervisor, which distinguishes its cookies and replies."""
        self._confirmed_s: float | None = None
        """Time of the last successful reading of the keys; None before the first one."""
        self._snapshot = KeySnapshot()
        self._turn = threading.Lock()
        self._passwords = PasswordCheck()
        self._write_queue = WriteQueue()
        self._sessions_turn = threading.Lock()
        """Lock held while a session is written or ended, so that no session is written after its
        end.
        """
        self._unwritten: dict[str, SessionRow] = {}
        """Sessions that are not in the journal yet, by the digest of their cookie."""
        self._signed_out = set[str]()
        """Digests of ended sessions that the journal still contains."""
        self._keys_used: dict[str, str] = {}
        self._sessions_used: dict[str, str] = {}
        self._session_used_s: dict[str, float] = {}
        """Time of the last use of each session, by the monotonic clock, in s."""

    @property
    def keys_wanted(self) -> bool:
        """Return whether a caller must show a key."""
        return self._always or self._had_keys

    @property
    def has_usable_key(self) -> bool:
        """Return whether any key is valid now."""
        return bool(_usable(self._snapshot.keys, self._now()))

    def _now(self) -> str:
        return utc_text(self.time.now())

    def refresh(self, store: Store) -> None:
        """Read keys that another program may have changed, and store when keys and sessions were
        used.

        Raises
        ------
        StoreError
            The key file cannot be read, or there is none although there were keys; or the journal
            cannot be used. In either case, keys that are revoked in the key file are rejected.
        """
        file, sessions = KeyFile(store.folder), SessionRepository(store)
        with self._turn:
            asked_s = self._clock()
            rows = file.read()
            if self._noted is None:
                # This precedes the check of any key: the clock may have been set back before this
                # program started.
                self.time.learn(file.latest_at() or self.time.now())
            # A revoked key is rejected, also while the journal cannot be used.
            self._had_keys = self._had_keys or bool(rows)
            self._snapshot = KeySnapshot(rows, self._snapshot.sessions)
            if not rows and (self._had_keys or store.get_note(KEYS_WANTED) is not None):
                self._had_keys = True
                raise file.missing()
            self._confirmed_s = asked_s
            if rows and not self._had_keys_noted:
                store.set_note(KEYS_WANTED, "1")
                self._had_keys_noted = True
            self._snapshot = KeySnapshot(rows, self._active_sessions(sessions, rows))
            keys_used, sessions_used = _drained(self._keys_used), _drained(self._sessions_used)
            if keys_used:
                file.note_use(keys_used)
            if sessions_used:
                sessions.note_use(sessions_used)
            self._note_time(file)

    def _active_sessions(
        self, repository: SessionRepository, keys: Sequence[KeyRow]
    ) -> list[SessionRow]:
        """Return the sessions; delete those that expired and those of revoked keys."""
        rows, now, clock_s = repository.all(), self.time.now(), self._clock()
        for row in rows:  # sessions of an earlier run, and new ones
            idle = max(timedelta(0), now - datetime.fromisoformat(row.used_at))
            self._session_used_s.setdefault(row.digest, clock_s - idle.total_seconds())
        known = {*(row.digest for row in rows), *self._unwritten}
        for digest in self._session_used_s.keys() - known:
            self._session_used_s.pop(digest, None)
        in_force = {key.digest for key in keys if key.revoked_at is None}
        ended = {row.digest for row in rows if self._is_idle(row) or row.key not in in_force}
        if ended:
            repository.sign_out(*ended)
        return [row for row in rows if row.digest not in ended]

    def _is_idle(self, session: SessionRow) -> bool:
        used_s = self._session_used_s.get(session.digest)
        return used_s is None or self._clock() - used_s > 3600.0 * IDLE_H

    def _note_time(self, file: KeyFile) -> None:
        """Store the time once an hour, and whenever a key has expired."""
        now, rows = self.time.now(), self._snapshot.keys
        noted = utc_text(now)[:HOUR], _usable(rows, utc_text(now))
        if noted != self._noted and rows:
            file.note_latest(now)
        self._noted = noted

    def agree_to_time(self, store: Store) -> None:
        """Accept the present time of day although a later one was seen; raises StoreError."""
        with self._turn:
            self.time.agree()
            KeyFile(store.folder).note_latest(self.time.now())

    @property
    def unconfirmed(self) -> bool:
        """Return whether a key may have been revoked unnoticed, since the keys cannot be read."""
        if self._confirmed_s is None:
            return False
        return self._clock() - self._confirmed_s > UNCONFIRMED_S

    def identify(self, address: str, shown: str | None, cookie: str | None) -> Caller:
        """Return the caller, identified by the key sent (valid or not), otherwise by a cookie."""
        if self.unconfirmed:
            return Caller(address, unconfirmed=True)
        if not self.keys_wanted:
            return Caller(address, scope=SCOPES[-1], way="open")
        now = self._now()
        if shown is not None:
            key = self._snapshot.key(shown, now)
            if key is None:
                return Caller(address, showed=True)
            self._note_use(key, now)
            return Caller(address, key.name, key.scope, "key", showed=True, digest=key.digest)
        found = None if cookie is None else self._session(cookie, now)
        if found is None:
            return Caller(address, showed=cookie is not None)
        session, key = found
        if self._is_idle(session):
            return Caller(address, showed=True)
        self._session_used_s[session.digest] = self._clock()
        self._note_use(key, now)
        if not _same_minute(session.used_at, now):
            self._sessions_used[session.digest] = now
        return Caller(address, key.name, key.scope, "session", showed=True, digest=key.digest)

    def _session(self, cookie: str, now: str) -> tuple[SessionRow, KeyRow] | None:
        snapshot = self._snapshot
        if digest_of(cookie) in self._signed_out:
            return None
        unwritten = KeySnapshot(snapshot.keys, list(self._unwritten.values()))
        return snapshot.session(cookie, now) or unwritten.session(cookie, now)

    def _note_use(self, key: KeyRow, now: str) -> None:
        if not _same_minute(key.used_at, now):
            self._keys_used[key.name] = now

    async def by_password(self, caller: Caller, name: str, password: str) -> Caller:
        """Return the user of a name and a password; raises ProblemError for too many attempts.

        A caller who has signed in as that user already does not have to wait.
        """
        if self.unconfirmed:
            return Caller(caller.address, unconfirmed=True)
        now = self._now()
        rows = [row for row in self._snapshot.keys if row.name == name and row.usable(now)]
        user = rows[0] if rows and rows[0].password is not None else None
        kept = None if user is None else user.password
        right = await self._passwords.is_right(
            name, caller.network, password, kept, trusted=caller.name == name
        )
        if not right or user is None:
            return Caller(caller.address, showed=True)
        self._note_use(user, now)
        return Caller(caller.address, user.name, user.scope, "key", showed=True, digest=user.digest)

    def sign_in(self, store: Store, caller: Caller, cookie: str) -> None:
        """Start a session, whose cookie replaces the key that a caller has sent.

        The session is valid at once, even while the journal cannot be written.
        """
        assert caller.digest
        row = SessionRow(digest_of(cookie), caller.digest, self._now())

        def write() -> None:
            with self._sessions_turn:
                if row.digest not in self._unwritten:  # the session was ended meanwhile
                    return
                SessionRepository(store).sign_in(row)
            self.refresh(store)
            self._unwritten.pop(row.digest, None)

        while len(self._unwritten) >= SESSIONS_MAX:
            self._unwritten.pop(next(iter(self._unwritten)), None)
        self._session_used_s[row.digest] = self._clock()
        self._unwritten[row.digest] = row
        self._write_queue.submit(write)

    @property
    def unwritten(self) -> int:
        """Return the number of sessions whose begin or end is not in the journal yet."""
        return len(self._unwritten) + len(self._signed_out)

    def write_sessions(self) -> None:
        """Write begins and ends of sessions that the journal could not store earlier."""
        self._write_queue.flush()

    def sign_out(self, store: Store, cookie: str) -> None:
        """End the session of a cookie.

        It ends at once, even while the journal cannot be written.
        """
        digest = digest_of(cookie)
        if digest in self._unwritten or any(
            row.digest == digest for row in self._snapshot.sessions
        ):
            self._signed_out.add(digest)
        self._unwritten.pop(digest, None)

        def write() -> None:
            with self._sessions_turn:
                SessionRepository(store).sign_out(digest)
            self.refresh(store)
            self._signed_out.discard(digest)

        self._write_queue.submit(write)


def _usable(rows: Sequence[KeyRow], now: str) -> frozenset[str]:
    """Return the names of the keys that are valid at a time."""
    return frozenset(row.name for row in rows if row.usable(now))


def _same_minute(used_at: str | None, now: str) -> bool:
    return used_at is not None and used_at[:16] == now[:16]


def _drained(used: dict[str, str]) -> dict[str, str]:
    """Remove and return the present entries; those that other threads add meanwhile stay."""
    found = dict(used)
    for name in found:
        used.pop(name, None)
    return found


def hours_before(now: str, hours: float) -> str:
    """Return the UTC time that is a number of hours before another one, in the journal's format."""
    return utc_text(datetime.fromisoformat(now) - timedelta(hours=hours))


def require_scope(caller: Caller, needed: Scope) -> None:
    """Raise ProblemError with the remedy: 401 for an unknown caller, 403 for a missing scope."""
    if caller.unconfirmed:
        raise ProblemError(
            503,
            "keys-unconfirmed",
            "The keys cannot be confirmed",
            f"the supervisor has not been able to read its keys for {UNCONFIRMED_S:g} s, and one "
            "may have been revoked meanwhile; the emergency stop still works",
            needed_scope=needed,
        )
    if caller.scope is None:
        why = (
            "the key or session is not accepted: it is wrong, revoked, expired or signed out"
            if caller.showed
            else "this supervisor requires a key: Authorization: Bearer KEY"
        )
        raise ProblemError(
            401,
            "no-key",
            "A key is required",
            f"{why}; `pincette key add` makes one on the supervisor's machine",
            headers={"WWW-Authenticate": REALM + (', error="invalid_token"' * caller.showed)},
            needed_scope=needed,
        )
    if not covers(caller.scope, needed):
        raise ProblemError(
            403,
            "scope-too-small",
            "The key may not do this",
            f"this needs scope {needed} ({MEANINGS[needed]}); key {caller.name!r} has "
            f"{caller.scope}",
            headers={"WWW-Authenticate": f'{REALM}, error="insufficient_scope", scope="{needed}"'},
            needed_scope=needed,
            scope=caller.scope,
        )
