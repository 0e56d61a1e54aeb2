"""Lets callers in: by what they show, and by what they ask for."""

import threading
from collections.abc import Callable

from pincette.api.access_models import MEANINGS, SCOPES, Scope, covers
from pincette_supervisor.access.caller import Caller
from pincette_supervisor.access.ring import Ring
from pincette_supervisor.access.secret import digest_of
from pincette_supervisor.journal.keys import KeyBook, KeyRow
from pincette_supervisor.journal.rows import utc_now
from pincette_supervisor.problems import ProblemError

REALM = 'Bearer realm="pincette"'


class Gate:
    """Who may do what. Looks at memory alone: an emergency stop waits for no disk and no lock.

    Keys are wanted where there are, or were, any: with the last one revoked nobody comes in.
    """

    def __init__(self, *, always: bool = False, now: Callable[[], str] = utc_now) -> None:
        self._always, self._now = always, now
        self._ring = Ring()
        self._turn = threading.Lock()
        self._keys_used: dict[str, str] = {}
        self._sessions_used: dict[str, str] = {}

    @property
    def keys_wanted(self) -> bool:
        """Whether a caller must show a key."""
        return self._always or bool(self._ring.keys)

    @property
    def has_usable_key(self) -> bool:
        """Whether anybody could come in with a key."""
        now = self._now()
        return any(row.usable(now) for row in self._ring.keys)

    def renew(self, book: KeyBook) -> None:
        """Look at the journal, where another program may have made or revoked a key.

        Raises
        ------
        StoreError
            Where it cannot be used; what was known stays in force.
        """
        with self._turn:
            self._ring = Ring(book.all(), book.sessions())
            keys, sessions = _taken(self._keys_used), _taken(self._sessions_used)
            if keys or sessions:
                book.note_use(keys, sessions)

    def known(self, address: str, shown: str | None, cookie: str | None) -> Caller:
        """Who asks: by the key that was shown, which may fail, else by a cookie."""
        if not self.keys_wanted:
            return Caller(address, scope=SCOPES[-1], way="open")
        now = self._now()
        if shown is not None:
            key = self._ring.key(shown, now)
            if key is None:
                return Caller(address, showed=True)
            self._use(key, now)
            return Caller(address, key.name, key.scope, "key", showed=True)
        found = None if cookie is None else self._ring.session(cookie, now)
        if found is None:
            return Caller(address, showed=cookie is not None)
        session, key = found
        self._use(key, now)
        if not _same_minute(session.used_at, now):
            self._sessions_used[session.digest] = now
        return Caller(address, key.name, key.scope, "session", showed=True)

    def _use(self, key: KeyRow, now: str) -> None:
        if not _same_minute(key.used_at, now):
            self._keys_used[key.name] = now

    def sign_in(self, book: KeyBook, caller: Caller, cookie: str) -> None:
        """Let a cookie stand for the key that a caller has shown."""
        assert caller.name is not None
        book.sign_in(digest_of(cookie), caller.name, self._now())
        self.renew(book)

    def sign_out(self, book: KeyBook, cookie: str) -> None:
        """Let a cookie stand for nothing."""
        book.sign_out(digest_of(cookie))
        self.renew(book)


def _same_minute(used_at: str | None, now: str) -> bool:
    """Whether it is not worth while to write the later of two times of the journal."""
    return used_at is not None and used_at[:16] == now[:16]


def _taken(used: dict[str, str]) -> dict[str, str]:
    """What was noted so far; what other threads note meanwhile stays for the next time."""
    found = dict(used)
    for name in found:
        used.pop(name, None)
    return found


def admit(caller: Caller, needed: Scope) -> None:
    """Let a caller pass who may do what is asked.

    Raises
    ------
    ProblemError
        401 of one that is not known, 403 of one that may not; with what to do.
    """
    if caller.scope is None:
        why = (
            "what was shown opens nothing: it is wrong, revoked, expired or signed out"
            if caller.showed
            else "this supervisor wants a key: Authorization: Bearer KEY"
        )
        raise ProblemError(
            401,
            "no-key",
            "A key is wanted",
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
