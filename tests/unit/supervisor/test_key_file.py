"""Keys in a file of their own: no lost or damaged file lets anybody in."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import pytest
from sqlalchemy import insert

from pincette_supervisor.access.access import authenticator_of, require_key
from pincette_supervisor.access.authentication import Authenticator, digest_of, new_cookie, new_key
from pincette_supervisor.access.key_store import open_keys
from pincette_supervisor.config import STORE, configure
from pincette_supervisor.journal.access_rows import KeyRepository
from pincette_supervisor.journal.database import KEY_FILE
from pincette_supervisor.journal.key_file import KeyFile, KeyRow
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.journal.tables import KEYS
from tests.support.rigs import demo_rig

HERE = "127.0.0.1"


def made(data: Path, name: str = "ann") -> str:
    with open_keys(data) as keys:
        return keys.add(name, "operate", None)[0]


def started(data: Path, keys: str = "once_made") -> Authenticator:
    """Who is let in by a supervisor that starts on a data folder."""
    config = configure(demo_rig({"supervisor": {"keys": keys}}), data)
    authenticator = authenticator_of(config, "")
    with closing(Store(config.store)) as store:
        authenticator.refresh(KeyRepository(store))
    require_key(config, authenticator)
    return authenticator


def lose_journal(data: Path) -> None:
    for path in data.glob(f"{STORE}*"):
        path.unlink()


def lose_keys(data: Path) -> None:
    (data / KEY_FILE).unlink()


@pytest.mark.parametrize("lose", [lose_journal, lose_keys])
def test_a_lost_file_lets_nobody_in_and_keeps_the_keys(
    tmp_path: Path, lose: Callable[[Path], None]
) -> None:
    key = made(tmp_path)
    lose(tmp_path)
    for _ in range(2):
        authenticator = started(tmp_path)
        assert authenticator.identify(HERE, None, None).scope is None
        assert authenticator.identify(HERE, key, None).scope == "operate"


@pytest.mark.parametrize("lose", [lose_journal, lose_keys])
def test_a_revoked_key_stays_revoked_whatever_is_lost(
    tmp_path: Path, lose: Callable[[Path], None]
) -> None:
    key = made(tmp_path)
    with open_keys(tmp_path) as keys:
        assert keys.revoke("ann")
    lose(tmp_path)
    authenticator = started(tmp_path)
    assert authenticator.identify(HERE, key, None).scope is None
    assert authenticator.identify(HERE, None, None).scope is None


def test_the_rig_file_may_require_keys_on_an_empty_data_folder(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert started(tmp_path).identify(HERE, None, None).way == "open"
    assert started(tmp_path, "always").identify(HERE, None, None).scope is None
    assert "none is in force, so nobody comes in: `pincette key add" in caplog.text
    key = made(tmp_path)
    assert started(tmp_path, "always").identify(HERE, key, None).scope == "operate"


@pytest.mark.parametrize(
    "lost", ["", "{", '{"version": 2, "keys": []}', '{"version": 1}', "\0" * 9]
)
def test_a_damaged_key_file_is_told_at_start_with_the_remedy(tmp_path: Path, lost: str) -> None:
    key = made(tmp_path)
    (tmp_path / KEY_FILE).write_text(lost)
    with pytest.raises(StoreError, match=r"keys\.json cannot be used: .*move it away"):
        started(tmp_path)
    with pytest.raises(StoreError, match=r"keys\.json cannot be used"):
        made(tmp_path, "bob")
    lose_keys(tmp_path)
    assert started(tmp_path).identify(HERE, key, None).scope == "operate"
    assert started(tmp_path).identify(HERE, None, None).scope is None


def test_a_digest_that_is_none_is_damage(tmp_path: Path) -> None:
    made(tmp_path)
    path = tmp_path / KEY_FILE
    path.write_text(path.read_text().replace('"digest": "', '"digest": "x'))
    with pytest.raises(StoreError, match="cannot be used"):
        KeyFile(tmp_path).read()


def test_nobody_comes_in_without_a_key_when_both_files_go_while_it_runs(tmp_path: Path) -> None:
    key, authenticator = made(tmp_path), Authenticator()
    with closing(Store(tmp_path / STORE)) as store:
        book = KeyRepository(store)
        authenticator.refresh(book)
        lose_keys(tmp_path)
        with store.writing() as connection:
            connection.execute(KEYS.delete())
        authenticator.refresh(book)
        assert authenticator.identify(HERE, None, None).scope is None
        assert authenticator.identify(HERE, key, None).scope is None


def test_a_key_is_revoked_also_while_the_journal_is_damaged(tmp_path: Path) -> None:
    key, authenticator = made(tmp_path), Authenticator()
    with closing(Store(tmp_path / STORE)) as store:
        book = KeyRepository(store)
        authenticator.refresh(book)
        authenticator.sign_in(book, authenticator.identify(HERE, key, None), cookie := new_cookie())
    lose_journal(tmp_path)
    (tmp_path / STORE).write_text("no journal\n" * 100)
    with open_keys(tmp_path) as keys:
        assert keys.revoke("ann")
    with pytest.raises(StoreError, match="is closed"):
        authenticator.refresh(book)
    assert authenticator.identify(HERE, key, None).scope is None
    assert authenticator.identify(HERE, None, cookie).scope is None


def test_keys_of_an_earlier_journal_are_brought_over_once(tmp_path: Path) -> None:
    keys = {name: new_key() for name in ("ann", "bob")}
    revoked = {"ann": None, "bob": "2026-03-02T12:00:00.000Z"}
    rows = [
        KeyRow(name, digest_of(key), "admin", "2026-03-01T12:00:00.000Z", revoked_at=revoked[name])
        for name, key in keys.items()
    ]
    with closing(Store(tmp_path / STORE)) as store, store.writing() as connection:
        connection.execute(insert(KEYS), [asdict(row) for row in rows])
    assert not (tmp_path / KEY_FILE).exists()
    authenticator = started(tmp_path)
    assert authenticator.identify(HERE, keys["ann"], None).scope == "admin"
    assert authenticator.identify(HERE, keys["bob"], None).scope is None
    assert KeyFile(tmp_path).read() == rows
    with closing(Store(tmp_path / STORE)) as store, store.writing() as connection:
        connection.execute(KEYS.update().values(revoked_at=None))
    authenticator = started(tmp_path)  # the file decides from here on
    assert authenticator.identify(HERE, keys["bob"], None).scope is None


def test_keys_and_journal_are_readable_by_their_owner_alone(tmp_path: Path) -> None:
    journal = tmp_path / STORE
    journal.touch(mode=0o644)  # as an earlier version left it
    made(tmp_path)
    with closing(Store(journal)) as store:
        store.set_note("a", "b")
        modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()}
    assert modes == dict.fromkeys((KEY_FILE, STORE, f"{STORE}-wal", f"{STORE}-shm"), 0o600)


def test_a_damaged_page_of_the_journal_is_told_when_it_is_opened(tmp_path: Path) -> None:
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
