"""The four properties of keys: no lost or damaged file admits a client, and no stop waits."""

import asyncio
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import NoReturn

import pytest

from pincette_supervisor.access.access import authenticator_of, require_key
from pincette_supervisor.access.authentication import Authenticator, Caller, new_cookie
from pincette_supervisor.access.key_store import open_keys
from pincette_supervisor.config import STORE, configure
from pincette_supervisor.journal.access import KeyFile
from pincette_supervisor.journal.database import KEY_FILE
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.journal.tables import NOTES
from tests.support.rigs import demo_rig
from tests.support.stores import open_store

HERE = "127.0.0.1"


def made(data: Path, name: str = "ann") -> str:
    with open_keys(data) as keys:
        return keys.add(name, "operate", None)[0]


def started(data: Path, keys: str = "once_made") -> Authenticator:
    """Return the authenticator of a supervisor that starts on a data folder."""
    config = configure(demo_rig({"supervisor": {"keys": keys}}), data)
    authenticator = authenticator_of(config, "")
    with closing(open_store(config.store)) as store:
        authenticator.refresh(store)
    require_key(config, authenticator)
    return authenticator


def lose_journal(data: Path) -> None:
    for path in data.glob(f"{STORE}*"):
        path.unlink()


def damage_journal(data: Path) -> None:
    lose_journal(data)
    (data / STORE).write_text("no journal\n" * 100)


def lose_keys(data: Path) -> None:
    (data / KEY_FILE).unlink()


def empty_keys(data: Path) -> None:
    (data / KEY_FILE).write_text('{"version": 1, "keys": []}')


def rights(authenticator: Authenticator, key: str | None, cookie: str | None = None) -> str | None:
    return authenticator.identify(HERE, key, cookie).scope


# First property: a lost or damaged journal opens no gate.


def test_the_loss_of_the_journal_changes_no_access_rights(tmp_path: Path) -> None:
    key, revoked = made(tmp_path), made(tmp_path, "bob")
    with open_keys(tmp_path) as keys:
        assert keys.revoke("bob")
    lose_journal(tmp_path)
    for _ in range(2):
        authenticator = started(tmp_path)
        assert rights(authenticator, None) is None
        assert rights(authenticator, key) == "operate"
        assert rights(authenticator, revoked) is None


def test_a_damaged_journal_prevents_the_start_but_no_change_of_keys(tmp_path: Path) -> None:
    key = made(tmp_path)
    damage_journal(tmp_path)
    with pytest.raises(StoreError, match=STORE):
        started(tmp_path)
    added = made(tmp_path, "bob")
    with open_keys(tmp_path) as keys:
        assert keys.revoke("ann")
        assert [row.name for row in keys.all()] == ["ann", "bob"]
    lose_journal(tmp_path)
    authenticator = started(tmp_path)
    assert rights(authenticator, added) == "operate"
    assert rights(authenticator, key) is None
    assert rights(authenticator, None) is None


def test_an_empty_key_file_beside_a_journal_that_cannot_be_used_states_why(tmp_path: Path) -> None:
    with closing(open_store(tmp_path / STORE)):
        pass
    damage_journal(tmp_path)
    with open_keys(tmp_path) as keys, pytest.raises(StoreError, match=STORE):
        keys.all()


# Second property: a revoked key opens nothing, even while the journal cannot be used.


@pytest.mark.parametrize("spoil", [lose_journal, damage_journal], ids=["lost", "damaged"])
def test_a_key_and_its_sessions_end_while_the_journal_cannot_be_used(
    tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    key, authenticator, cookie = made(tmp_path), Authenticator(), new_cookie()
    with closing(open_store(tmp_path / STORE)) as store:
        authenticator.refresh(store)
        authenticator.sign_in(store, authenticator.identify(HERE, key, None), cookie)
    assert rights(authenticator, None, cookie) == "operate"
    spoil(tmp_path)
    with open_keys(tmp_path) as keys:
        assert keys.revoke("ann")
    with pytest.raises(StoreError, match="is closed"):
        authenticator.refresh(store)
    assert rights(authenticator, key) is None
    assert rights(authenticator, None, cookie) is None


def test_a_new_password_ends_the_sessions_while_the_journal_cannot_be_used(tmp_path: Path) -> None:
    authenticator, cookie = Authenticator(), new_cookie()
    with open_keys(tmp_path) as keys:
        keys.add_user("ann", "operate", "the first password")
    with closing(open_store(tmp_path / STORE)) as store:
        authenticator.refresh(store)
        signed_in = authenticator.by_password(Caller(HERE), "ann", "the first password")
        authenticator.sign_in(store, asyncio.run(signed_in), cookie)
    assert rights(authenticator, None, cookie) == "operate"
    damage_journal(tmp_path)
    with open_keys(tmp_path) as keys:
        assert keys.set_password("ann", "the second password")
    with pytest.raises(StoreError, match="is closed"):
        authenticator.refresh(store)
    assert rights(authenticator, None, cookie) is None


# Third property: identifying a caller, and so a stop, waits for no disk.


def test_a_caller_is_identified_without_access_to_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    key, cookie = made(tmp_path), new_cookie()
    with closing(open_store(tmp_path / STORE)) as store:
        authenticator = Authenticator()
        authenticator.refresh(store)
        authenticator.sign_in(store, authenticator.identify(HERE, key, None), cookie)

    def no_disk(*_: object, **__: object) -> NoReturn:
        raise AssertionError("the disk was used")

    for owner, name in ((KeyFile, "read"), (KeyFile, "note_use"), (Store, "reading")):
        monkeypatch.setattr(owner, name, no_disk)
    monkeypatch.setattr(Store, "writing", no_disk)
    assert rights(authenticator, key) == "operate"
    assert rights(authenticator, None, cookie) == "operate"
    assert rights(authenticator, "wrong") is None
    assert rights(authenticator, None) is None


# Fourth property: once there was a key, keys are wanted.


@pytest.mark.parametrize("lose", [lose_keys, empty_keys])
def test_without_its_key_file_a_supervisor_that_had_keys_does_not_start(
    tmp_path: Path, lose: Callable[[Path], None]
) -> None:
    made(tmp_path)
    lose(tmp_path)
    for _ in range(2):
        with pytest.raises(StoreError, match="pincette key add NAME --scope admin --data"):
            started(tmp_path)
    key = made(tmp_path, "bob")
    authenticator = started(tmp_path)
    assert rights(authenticator, None) is None
    assert rights(authenticator, key) == "operate"


def test_a_supervisor_loads_keys_added_beside_a_damaged_journal(tmp_path: Path) -> None:
    damage_journal(tmp_path)
    made(tmp_path)
    lose_journal(tmp_path)
    started(tmp_path)
    lose_keys(tmp_path)
    with pytest.raises(StoreError, match="has had keys"):
        started(tmp_path)


@pytest.mark.parametrize("lose", [lose_keys, empty_keys])
def test_a_running_supervisor_without_its_key_file_refuses_all_requests_until_it_returns(
    tmp_path: Path, lose: Callable[[Path], None]
) -> None:
    key, cookie, authenticator = made(tmp_path), new_cookie(), Authenticator()
    kept = (tmp_path / KEY_FILE).read_bytes()
    with closing(open_store(tmp_path / STORE)) as store:
        authenticator.refresh(store)
        authenticator.sign_in(store, authenticator.identify(HERE, key, None), cookie)
        lose(tmp_path)
        with store.writing() as connection:  # the note goes, too
            connection.execute(NOTES.delete())
        for _ in range(2):
            with pytest.raises(StoreError, match="has had keys"):
                authenticator.refresh(store)
            assert rights(authenticator, None) is None
            assert rights(authenticator, key) is None
            assert rights(authenticator, None, cookie) is None
        (tmp_path / KEY_FILE).write_bytes(kept)
        authenticator.refresh(store)
        assert rights(authenticator, key) == "operate"
        assert rights(authenticator, None, cookie) == "operate"
        assert rights(authenticator, None) is None


def test_the_rig_file_may_require_keys_on_an_empty_data_folder(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert started(tmp_path).identify(HERE, None, None).way == "open"
    assert started(tmp_path, "always").identify(HERE, None, None).scope is None
    assert "none is valid, so every request is refused: `pincette key add" in caplog.text
    key = made(tmp_path)
    assert started(tmp_path, "always").identify(HERE, key, None).scope == "operate"


@pytest.mark.parametrize(
    "lost", ["", "{", '{"version": 2, "keys": []}', '{"version": 1}', "\0" * 9]
)
def test_a_damaged_key_file_is_reported_at_start_with_the_remedy(tmp_path: Path, lost: str) -> None:
    key = made(tmp_path)
    (tmp_path / KEY_FILE).write_text(lost)
    with pytest.raises(StoreError, match=r"keys\.json cannot be used: .*move it away"):
        started(tmp_path)
    with pytest.raises(StoreError, match=r"keys\.json cannot be used"):
        made(tmp_path, "bob")
    lose_keys(tmp_path)
    with pytest.raises(StoreError, match="has had keys"):
        started(tmp_path)
    with open_keys(tmp_path) as keys:
        keys.add("bob", "operate", None)
    assert started(tmp_path).identify(HERE, key, None).scope is None


def test_an_invalid_digest_counts_as_damage(tmp_path: Path) -> None:
    made(tmp_path)
    path = tmp_path / KEY_FILE
    path.write_text(path.read_text().replace('"digest": "', '"digest": "x'))
    with pytest.raises(StoreError, match="cannot be used"):
        KeyFile(tmp_path).read()


def test_keys_and_journal_are_readable_by_their_owner_only(tmp_path: Path) -> None:
    journal = tmp_path / STORE
    journal.touch(mode=0o644)  # as an earlier version left it
    made(tmp_path)
    with closing(Store(journal)) as store:
        store.set_note("a", "b")
        modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()}
    assert modes == dict.fromkeys((KEY_FILE, STORE, f"{STORE}-wal", f"{STORE}-shm"), 0o600)


def test_a_damaged_page_of_the_journal_is_reported_at_opening(tmp_path: Path) -> None:
    path = tmp_path / STORE
    with closing(Store(path)) as store:
        for number in range(300):
            store.add_event("2026-03-01T12:00:00.000Z", "demo", None, "state", {"n": "x" * number})
    with closing(sqlite3.connect(path)) as base:
        base.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        (size,) = base.execute("PRAGMA page_size").fetchone()
    with path.open("r+b") as file:
        file.seek(path.stat().st_size - 3 * size)
        file.write(b"\xff" * size)
    with pytest.raises(StoreError, match=r"it is damaged.*move it away"):
        Store(path)
