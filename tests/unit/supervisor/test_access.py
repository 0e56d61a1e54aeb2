"""Keys and sessions: stored data, admitted clients, and expiry."""

import re
from datetime import datetime, timedelta
from pathlib import Path
from time import monotonic

import pytest

from pincette.api.access import SCOPES, Scope, covers
from pincette_supervisor.access.authentication import (
    IDLE_H,
    Authenticator,
    Caller,
    digest_of,
    new_cookie,
    new_key,
    require_scope,
)
from pincette_supervisor.journal import access
from pincette_supervisor.journal.access import KeyFile, KeyNameTakenError, SessionRepository
from pincette_supervisor.journal.store import Store
from pincette_supervisor.journal.tables import utc_text
from pincette_supervisor.problems import ProblemError

NOW = "2126-03-01T12:00:00.000Z"
"""Time later than any test run, so that everything that a test makes is older."""
HERE = "127.0.0.1"


@pytest.fixture
def book(store: Store) -> KeyFile:
    return KeyFile(store.folder)


class Clock:
    """A time of day that a test advances or sets, and the elapsed time."""

    def __init__(self) -> None:
        self.now, self.passed_s = NOW, 0.0

    def wall(self) -> datetime:
        return datetime.fromisoformat(self.now)

    def pass_s(self, duration_s: float) -> None:
        self.passed_s += duration_s
        self.now = utc_text(self.wall() + timedelta(seconds=duration_s))

    def authenticator(self) -> Authenticator:
        return Authenticator(wall=self.wall, clock=lambda: self.passed_s)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def authenticator(clock: Clock) -> Authenticator:
    return clock.authenticator()


def made(book: KeyFile, name: str, scope: Scope = "operate", expires_at: str | None = None) -> str:
    key = new_key()
    book.add(name, digest_of(key), scope, expires_at)
    return key


def test_a_scope_includes_all_lower_scopes() -> None:
    held = [(has, needed) for has in SCOPES for needed in SCOPES if covers(has, needed)]
    assert held == [
        ("observe", "observe"),
        ("propose", "observe"),
        ("propose", "propose"),
        ("operate", "observe"),
        ("operate", "propose"),
        ("operate", "operate"),
        ("admin", "observe"),
        ("admin", "propose"),
        ("admin", "operate"),
        ("admin", "admin"),
    ]


def test_keys_are_long_and_distinct_and_identified_by_their_beginning() -> None:
    keys = {new_key() for _ in range(100)}
    assert len(keys) == 100
    assert all(re.fullmatch(r"pincette_[A-Za-z0-9_-]{43}", key) for key in keys)


def test_no_file_holds_a_key_or_a_cookie(
    book: KeyFile, authenticator: Authenticator, tmp_path: Path, store: Store
) -> None:
    key, cookie = made(book, "ann"), new_cookie()
    authenticator.refresh(store)
    authenticator.sign_in(store, authenticator.identify(HERE, key, None), cookie)
    written = b"".join(file.read_bytes() for file in tmp_path.iterdir())
    assert digest_of(key).encode() in written
    assert key.encode() not in written
    assert key.removeprefix("pincette_").encode() not in written
    assert cookie.encode() not in written


def test_without_keys_every_client_may_do_everything(authenticator: Authenticator) -> None:
    caller = authenticator.identify(HERE, "whatever is shown", None)
    assert (caller.scope, caller.name, caller.way) == ("admin", None, "open")
    require_scope(caller, "admin")


def test_once_a_key_exists_clients_without_a_key_are_refused(
    book: KeyFile, authenticator: Authenticator, store: Store
) -> None:
    key = made(book, "ann")
    authenticator.refresh(store)
    for wrong in (None, "", key[:-1], f"{key}x", key.lower(), digest_of(key), "x" * 10_000, "ä"):
        with pytest.raises(ProblemError) as refused:
            require_scope(authenticator.identify(HERE, wrong, None), "observe")
        assert refused.value.status == 401
        assert (refused.value.headers or {})["WWW-Authenticate"].startswith("Bearer realm=")
        assert not wrong or wrong not in refused.value.detail
    assert authenticator.identify(HERE, key, None).name == "ann"


@pytest.mark.parametrize("has", SCOPES)
@pytest.mark.parametrize("needed", SCOPES)
def test_a_scope_that_is_too_small_is_reported_with_both_scopes(has: Scope, needed: Scope) -> None:
    caller = Caller(HERE, "ann", has, "key")
    if covers(has, needed):
        require_scope(caller, needed)
        return
    with pytest.raises(ProblemError) as refused:
        require_scope(caller, needed)
    assert refused.value.status == 403
    assert f"needs scope {needed}" in refused.value.detail
    assert f"key 'ann' has {has}" in refused.value.detail
    wanted = f'error="insufficient_scope", scope="{needed}"'
    assert wanted in (refused.value.headers or {})["WWW-Authenticate"]


def test_a_revoked_key_is_refused_and_keys_stay_required(
    book: KeyFile, authenticator: Authenticator, store: Store
) -> None:
    key, cookie = made(book, "ann"), new_cookie()
    authenticator.refresh(store)
    authenticator.sign_in(store, authenticator.identify(HERE, key, None), cookie)
    assert authenticator.identify(HERE, None, cookie).way == "session"
    assert book.revoke("ann")
    authenticator.refresh(store)
    assert authenticator.identify(HERE, key, None).scope is None
    assert authenticator.identify(HERE, None, cookie).scope is None
    assert authenticator.keys_wanted
    assert not authenticator.has_usable_key
    assert not book.revoke("ann")
    assert not book.revoke("bob")


def test_a_key_is_refused_after_its_expiry(
    book: KeyFile, authenticator: Authenticator, clock: Clock, store: Store
) -> None:
    key = made(book, "ann", expires_at="2126-03-01T12:00:01.000Z")
    authenticator.refresh(store)
    assert authenticator.identify(HERE, key, None).scope == "operate"
    clock.now = "2126-03-01T12:00:01.000Z"
    assert authenticator.identify(HERE, key, None).scope is None


def test_a_session_ends_after_a_long_time_without_requests(
    book: KeyFile, authenticator: Authenticator, clock: Clock, store: Store
) -> None:
    key, cookie = made(book, "ann"), new_cookie()
    authenticator.refresh(store)
    authenticator.sign_in(store, authenticator.identify(HERE, key, None), cookie)
    for _ in range(2):
        clock.pass_s(3600.0 * (IDLE_H - 0.1))
        for _ in range(2):  # stores the last use, and reads what is stored
            authenticator.refresh(store)
        assert authenticator.identify(HERE, None, cookie).way == "session"
    clock.pass_s(3600.0 * (IDLE_H + 0.1))
    authenticator.refresh(store)
    assert authenticator.identify(HERE, None, cookie).scope is None
    assert SessionRepository(store).all() == []


def test_a_wrong_key_is_refused_even_with_a_valid_cookie(
    book: KeyFile, authenticator: Authenticator, store: Store
) -> None:
    key, cookie = made(book, "ann"), new_cookie()
    authenticator.refresh(store)
    authenticator.sign_in(store, authenticator.identify(HERE, key, None), cookie)
    assert authenticator.identify(HERE, "wrong", cookie).scope is None


def test_the_number_of_sessions_is_bounded(
    book: KeyFile,
    authenticator: Authenticator,
    store: Store,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(access, "SESSIONS_MAX", 5)
    key = made(book, "ann")
    authenticator.refresh(store)
    caller = authenticator.identify(HERE, key, None)
    for _ in range(5 + 3):
        authenticator.sign_in(store, caller, new_cookie())
    deadline_s = monotonic() + 20.0
    while authenticator.unwritten:
        assert monotonic() < deadline_s
        authenticator.write_sessions()
    assert len(SessionRepository(store).all()) == 5


def test_the_use_of_a_key_is_stored_once_a_minute(
    book: KeyFile,
    authenticator: Authenticator,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
    store: Store,
) -> None:
    key = made(book, "ann")
    authenticator.refresh(store)
    noted: list[dict[str, str]] = []
    keep = KeyFile.note_use

    def note_use(file: KeyFile, used_at: dict[str, str]) -> None:
        noted.append(used_at)
        keep(file, used_at)

    monkeypatch.setattr(KeyFile, "note_use", note_use)
    for second in range(3):
        clock.now = f"2126-03-01T12:00:0{second}.000Z"
        authenticator.identify(HERE, key, None)
        authenticator.refresh(store)
        authenticator.refresh(store)
    assert noted == [{"ann": NOW}]
    assert [row.used_at for row in book.read()] == [NOW]


def test_the_name_of_a_key_is_unique(book: KeyFile) -> None:
    made(book, "ann")
    book.revoke("ann")
    with pytest.raises(KeyNameTakenError):
        made(book, "ann", "admin")


def test_beyond_loopback_keys_are_required_even_before_the_first_one() -> None:
    authenticator = Authenticator(always=True)
    assert authenticator.keys_wanted
    assert authenticator.identify("192.168.1.20", None, None).scope is None


@pytest.mark.parametrize(
    ("caller", "label", "signed"),
    [
        (Caller(HERE, scope="admin", way="open"), "Ann", "Ann"),
        (Caller(HERE, scope="admin", way="open"), "", HERE),
        (Caller(HERE, "cell-7", "operate", "key"), "Ann", "cell-7 (Ann)"),
        (Caller(HERE, "cell-7", "operate", "key"), "", "cell-7"),
        (Caller("10.0.0.9"), "cell-7", "10.0.0.9"),
    ],
)
def test_if_keys_are_required_the_identity_is_that_of_the_key_and_not_of_the_label(
    caller: Caller, label: str, signed: str
) -> None:
    assert caller.signed(label) == signed


def test_known_keys_stay_in_force_while_the_journal_cannot_be_read(
    book: KeyFile, authenticator: Authenticator, store: Store
) -> None:
    key = made(book, "ann")
    authenticator.refresh(store)
    store.close()
    with pytest.raises(OSError, match="is closed"):
        authenticator.refresh(store)
    assert authenticator.identify(HERE, key, None).name == "ann"
    assert authenticator.identify(HERE, "wrong", None).scope is None
