"""Jobs in SQLite survive a restart."""

import sqlite3
from pathlib import Path

import pytest

from pincette_supervisor.journal.store import SCHEMA_VERSION, ActionRow, JobRow, Store, StoreError

AT = "2026-03-01T12:00:00.000Z"


def row(name: str, created_at: str = AT) -> JobRow:
    return JobRow(name, "grip", "demo", "queued", {"kind": "grip"}, {"duration_s": 1.5}, created_at)


def test_what_was_kept_is_read_back_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "jobs.sqlite"
    store = Store(path)
    store.add(row("a"))
    number = store.add_action("a", ActionRow("stop", AT, "127.0.0.1"))
    store.action_took_effect("a", number, 42)
    store.change("a", state="stopped", cause="", result={"outcome": "stopped"}, ended_at=AT)
    store.note("actuator", "17")
    store.close()
    again = Store(path)
    job = again.get("a")
    assert job is not None
    assert job.state == "stopped"
    assert job.plan == {"duration_s": 1.5}
    assert job.result == {"outcome": "stopped"}
    assert job.actions == (ActionRow("stop", AT, "127.0.0.1", 42),)
    assert again.noted("actuator") == "17"
    assert again.noted("other") is None
    again.close()


def test_jobs_left_unfinished_become_interrupted(tmp_path: Path) -> None:
    store = Store(tmp_path / "jobs.sqlite")
    for name, state in (("a", "running"), ("b", "succeeded"), ("c", "queued")):
        store.add(row(name))
        store.change(name, state=state)
    assert store.interrupt_left_over(AT) == ["a", "c"]
    states = {job.id: job.state for job in store.newest(10)}
    assert states == {"a": "interrupted", "b": "succeeded", "c": "interrupted"}
    job = store.get("a")
    assert job is not None
    assert job.ended_at == AT
    assert "supervisor" in job.cause
    store.close()


def test_the_newest_come_first(tmp_path: Path) -> None:
    store = Store(tmp_path / "jobs.sqlite")
    for second in range(3):
        store.add(row(f"job{second}", f"2026-03-01T12:00:0{second}.000Z"))
    assert [job.id for job in store.newest(2)] == ["job2", "job1"]
    assert store.get("none") is None
    store.close()


def test_a_store_of_another_schema_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "jobs.sqlite"
    base = sqlite3.connect(path)
    base.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    base.close()
    with pytest.raises(StoreError, match=f"schema {SCHEMA_VERSION + 1}"):
        Store(path)


def test_a_file_that_is_no_store_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "jobs.sqlite"
    path.write_text("this is a text, and longer than the header of a data base would be\n" * 20)
    with pytest.raises(StoreError, match="move it away"):
        Store(path)


def test_only_what_may_change_changes(tmp_path: Path) -> None:
    store = Store(tmp_path / "jobs.sqlite")
    store.add(row("a"))
    with pytest.raises(ValueError, match="request cannot be changed"):
        store.change("a", request="{}")
    store.close()
