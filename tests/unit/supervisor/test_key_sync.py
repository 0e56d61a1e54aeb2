"""Keys that cannot be read or locked, as on a network share: no client stays admitted by
accident."""

import asyncio
import errno
import fcntl
import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from threading import Event

import pytest
from sqlalchemy.exc import OperationalError

from pincette_supervisor.access.access import EVERY_S, Access, KeySync
from pincette_supervisor.access.authentication import (
    UNCONFIRMED_S,
    Authenticator,
    Caller,
    require_scope,
)
from pincette_supervisor.access.key_store import open_keys
from pincette_supervisor.config import STORE
from pincette_supervisor.journal import engines
from pincette_supervisor.journal.access import KeyFile
from pincette_supervisor.journal.database import KEY_FILE
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.watch import of_supervisor

HERE = "127.0.0.1"
LONG_S = 20.0
NUMBERS = [errno.EBADF, errno.ENOLCK, errno.EIO, errno.ENOTSUP, errno.EINVAL]


def made(data: Path, name: str = "ann") -> str:
    with open_keys(data) as keys:
        return keys.add(name, "operate", None)[0]


def without_locks(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def refuse(_descriptor: int, _operation: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refuse)


def until(holds: Callable[[], bool]) -> None:
    wait = Event()
    for _ in range(int(LONG_S / 0.02)):
        if holds():
            return
        wait.wait(0.02)
    raise AssertionError("the condition was not met in time")


@pytest.mark.parametrize("number", NUMBERS)
def test_a_key_can_be_revoked_without_file_locks(
    tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    key, file = made(tmp_path), tmp_path / KEY_FILE
    in_force = file.read_bytes()
    with open_keys(tmp_path) as keys:
        assert keys.revoke("ann")
    revoked = file.read_bytes()
    file.write_bytes(in_force)
    access = Access()
    with closing(KeySync(store, access)):
        without_locks(monkeypatch, number)
        assert access.authenticator.identify(HERE, key, None).scope == "operate"  # its use is noted
        until(lambda: "keys" in store.troubles)
        assert str(file) in store.troubles["keys"]
        assert [check.name for check in of_supervisor(store) if not check.ok] == ["keys"]
        file.write_bytes(revoked)  # by another machine
        until(lambda: access.authenticator.identify(HERE, key, None).scope is None)


def test_unreadable_keys_refuse_all_requests_until_they_can_be_read(
    tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    key, now_s = made(tmp_path), 100.0
    authenticator = Authenticator(clock=lambda: now_s)
    authenticator.refresh(store)

    def refuse(_file: KeyFile) -> None:
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patched:
        patched.setattr(KeyFile, "read", refuse)
        now_s += UNCONFIRMED_S
        with pytest.raises(OSError, match="Input/output"):
            authenticator.refresh(store)
        assert authenticator.identify(HERE, key, None).scope == "operate"
        now_s += EVERY_S
        for caller in (
            authenticator.identify(HERE, key, None),
            authenticator.identify(HERE, None, "cookie"),
            authenticator.identify(HERE, None, None),
            asyncio.run(authenticator.by_password(Caller(HERE), "ann", "secret")),
        ):
            assert caller == Caller(HERE, unconfirmed=True)
            with pytest.raises(ProblemError) as refused:
                require_scope(caller, "observe")
            assert (refused.value.status, refused.value.code) == (503, "keys-unconfirmed")
    authenticator.refresh(store)
    assert authenticator.identify(HERE, key, None).scope == "operate"


@pytest.mark.parametrize("number", NUMBERS)
def test_a_failed_lock_reports_path_and_remedy_and_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    made(tmp_path)
    before = (tmp_path / KEY_FILE).read_bytes()
    without_locks(monkeypatch, number)
    with pytest.raises(StoreError, match=r"keys\.json cannot be locked.*local disk"):
        KeyFile(tmp_path).revoke("ann")
    assert (tmp_path / KEY_FILE).read_bytes() == before
    with (
        closing(Store(tmp_path / STORE)) as store,
        pytest.raises(StoreError, match=r"local disk.*PINCETTE_STORE") as refused,
    ):
        store.work_alone()
    assert str(tmp_path / STORE) in str(refused.value)
    assert "move it away" not in str(refused.value)


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("SQLITE_IOERR", "PINCETTE_STORE"),
        ("SQLITE_IOERR_LOCK", "PINCETTE_STORE"),
        ("SQLITE_IOERR_SHMMAP", "PINCETTE_STORE"),
        ("SQLITE_PROTOCOL", "PINCETTE_STORE"),
        ("SQLITE_NOLFS", "PINCETTE_STORE"),
        ("SQLITE_CANTOPEN", "free space and permissions"),
        ("SQLITE_READONLY_DBMOVED", "free space and permissions"),
        ("SQLITE_FULL", "free space and permissions"),
        ("SQLITE_BUSY", "another program"),
        ("SQLITE_CORRUPT", "move it away"),
        ("SQLITE_NOTADB", "move it away"),
    ],
)
def test_the_remedy_to_move_the_journal_away_is_given_only_if_it_is_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, wanted: str
) -> None:
    cause = sqlite3.OperationalError("disk I/O error")
    cause.sqlite_errorname = name

    def refuse(_connection: object) -> None:
        raise OperationalError("PRAGMA", None, cause)

    monkeypatch.setattr(engines, "require_sound", refuse)
    with pytest.raises(StoreError, match=wanted) as refused:
        Store(tmp_path / STORE)
    assert ("move it away" in str(refused.value)) == (wanted == "move it away")
