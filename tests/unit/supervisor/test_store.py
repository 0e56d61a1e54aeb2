"""Jobs, actions, keys and events survive a restart."""

import math
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import text

from pincette_supervisor.config import STORE
from pincette_supervisor.journal import store as store_module
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import (
    ActionRow,
    JobRow,
    KeyTakenError,
    Store,
    StoreError,
)
from pincette_supervisor.journal.tables import Creation

AT = "2026-03-01T12:00:00.000Z"


def row(name: str, created_at: str = AT) -> JobRow:
    return JobRow(name, "grip", "demo", "queued", {"kind": "grip"}, {"duration_s": 1.5}, created_at)


def test_stored_data_is_read_back_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "jobs.sqlite"
    store = Store(path)
    store.add(row("a"))
    number = store.add_action("a", ActionRow("stop", AT, "127.0.0.1"))
    store.action_took_effect("a", number, 42, AT)
    store.change(
        "a", state="stopped", cause="", result={"outcome": "stopped"}, ended_at=AT, epoch=2**48 - 1
    )
    store.set_note("actuator", "17")
    store.close()
    again = Store(path)
    job = again.get("a")
    assert job is not None
    assert job.state == "stopped"
    assert job.plan == {"duration_s": 1.5}
    assert job.result == {"outcome": "stopped"}
    assert job.epoch == 2**48 - 1
    assert job.actions == (ActionRow("stop", AT, "127.0.0.1", 42, AT),)
    assert again.get_note("actuator") == "17"
    assert again.get_note("other") is None
    again.close()


def test_a_note_replaces_the_previous_one(store: Store) -> None:
    store.set_note("actuator", "17")
    store.set_note("actuator", "18")
    assert store.get_note("actuator") == "18"


def test_unfinished_jobs_become_interrupted_and_queued_ones_are_kept(store: Store) -> None:
    for name, state in (("a", "running"), ("b", "succeeded"), ("c", "queued"), ("d", "aborting")):
        store.add(row(name))
        store.change(name, state=state)
    assert store.interrupt_unfinished(AT) == ["a", "d"]
    states = {job.id: job.state for job in store.newest(10)}
    assert states == {"a": "interrupted", "b": "succeeded", "c": "queued", "d": "interrupted"}
    job = store.get("a")
    assert job is not None
    assert (job.ended_at, job.revision) == (AT, 3)
    assert "supervisor" in job.cause


def test_the_newest_are_first(store: Store) -> None:
    for second in range(3):
        store.add(row(f"job{second}", f"2026-03-01T12:00:0{second}.000Z"))
    assert [job.id for job in store.newest(2)] == ["job2", "job1"]
    assert [job.id for job in store.newest(2, JobFilter(before_number=2))] == ["job0"]
    assert store.get("none") is None


def test_the_list_can_be_filtered(store: Store) -> None:
    store.add(row("a"))
    store.add(replace(row("b"), labels={"cell.line-1": "left", "lot": "7"}))
    store.add(replace(row("c"), kind="track", rig="other"))
    store.change("a", state="failed")

    def names(jobs: list[JobRow]) -> list[str]:
        return [job.id for job in jobs]

    assert names(store.newest(9, JobFilter(kind="track"))) == ["c"]
    assert names(store.newest(9, JobFilter(state="failed"))) == ["a"]
    assert names(store.newest(9, JobFilter(rig="demo"))) == ["b", "a"]
    assert names(store.newest(9, JobFilter(label=("cell.line-1", "left")))) == ["b"]
    assert names(store.newest(9, JobFilter(label=("lot", "8")))) == []
    assert names(store.newest(9, JobFilter(rig="demo", state="queued"))) == ["b"]


def test_the_queue_is_in_the_order_of_the_numbers(store: Store) -> None:
    kept = [store.add(row(name)) for name in ("c", "a", "b")]
    assert [job.number for job in kept] == [1, 2, 3]
    store.add(replace(row("x"), rig="other"))
    store.change("a", state="preparing")
    assert [(job.id, job.number) for job in store.queued("demo")] == [("c", 1), ("b", 3)]
    assert store.queued("none") == []


def test_every_change_raises_the_revision(store: Store) -> None:
    assert store.add(row("a")).revision == 1
    assert store.change("a", cause="x") == 2
    number = store.add_action("a", ActionRow("start", AT, "me"))
    store.action_took_effect("a", number, 0, AT)
    job = store.get("a")
    assert job is not None
    assert job.revision == 4
    assert job.actions[0].applied_at is not None


def test_a_key_creates_one_job(tmp_path: Path, store: Store) -> None:
    store.add(row("a"), "key", "f1")
    with pytest.raises(KeyTakenError) as refused:
        store.add(row("b"), "key", "f2")
    assert (refused.value.job, refused.value.fingerprint) == ("a", "f1")
    assert store.get("b") is None
    store.close()
    again = Store(tmp_path / STORE)
    assert again.created("key") == Creation("key", "f1", "a", AT)
    assert again.created("other") is None
    again.close()


def test_concurrent_requests_with_the_same_key_create_one_job(store: Store) -> None:
    gate, losers = threading.Barrier(8), list[str]()

    def create(name: str) -> None:
        gate.wait()
        try:
            store.add(row(name), "key", name)
        except KeyTakenError as error:
            losers.append(error.job)

    threads = [threading.Thread(target=create, args=(f"job{n}",)) for n in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    (winner,) = store.newest(10)
    assert losers == [winner.id] * 7


def test_threads_write_and_read_concurrently(store: Store) -> None:
    store.add(row("a"))

    def change() -> None:
        for _ in range(25):
            store.change("a", cause="x")
            assert store.get("a") is not None

    threads = [threading.Thread(target=change) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    job = store.get("a")
    assert job is not None
    assert job.revision == 1 + 8 * 25


def test_events_are_numbered_and_can_be_filtered(tmp_path: Path, store: Store) -> None:
    assert store.event_span() == (0, 0)
    for rig, job in (("demo", "a"), ("demo", None), ("other", "b"), ("demo", "a")):
        store.add_event(AT, rig, job, "state", {"state": "running"})
    assert [event.number for event in store.events_after(0)] == [1, 2, 3, 4]
    assert [event.number for event in store.events_after(1, rig="demo")] == [2, 4]
    assert [event.number for event in store.events_after(0, job="a")] == [1, 4]
    assert [event.number for event in store.events_after(0, limit=2)] == [1, 2]
    assert store.events_after(3)[0].body == {"state": "running"}
    store.close()
    again = Store(tmp_path / STORE)
    assert again.event_span()[1] == 4
    again.close()


def test_storing_an_event_deletes_the_oldest_ones_beyond_the_limit(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store_module, "EVENTS_KEPT", 20)
    monkeypatch.setattr(store_module, "EVENTS_SWEEP", 10)
    for _ in range(65):
        store.add_event(AT, "demo", None, "state", {})
    assert store.event_span() == (40, 65)
    monkeypatch.setattr(store_module, "EVENTS_KEPT", 1)
    monkeypatch.setattr(store_module, "EVENTS_SWEEP", 5)
    for _ in range(5):
        store.add_event(AT, "demo", None, "state", {})
    # Not all surplus rows are deleted at once, so that no caller waits long.
    assert store.event_span() == (50, 70)


def test_an_event_number_is_never_used_twice(store: Store) -> None:
    store.add_event(AT, "demo", None, "state", {})
    store.add_event(AT, "demo", None, "state", {})
    with store.writing() as base:
        base.execute(text("DELETE FROM events"))
    assert store.add_event(AT, "demo", None, "state", {}) == 3


def test_only_changeable_columns_change(store: Store) -> None:
    store.add(row("a"))
    with pytest.raises(ValueError, match="request cannot be changed"):
        store.change("a", request="{}")
    with pytest.raises(LookupError, match="no job 'b'"):
        store.change("b", cause="x")


def test_a_number_that_json_lacks_is_refused_and_nothing_changes(store: Store) -> None:
    store.add(row("a"))
    with pytest.raises(ValueError, match="not JSON compliant"):
        store.change("a", state="failed", result={"x_um": math.nan})
    job = store.get("a")
    assert job is not None
    assert (job.state, job.result, job.revision) == ("queued", None, 1)


def test_a_closed_store_is_reported(store: Store) -> None:
    store.close()
    with pytest.raises(StoreError, match=r"supervisor\.sqlite is closed"):
        store.get("a")
    with pytest.raises(StoreError, match="is closed"):
        store.set_note("a", "b")


def test_a_failing_database_is_named(store: Store) -> None:
    with store.writing() as base:
        base.execute(text("DROP TABLE notes"))
    with pytest.raises(StoreError, match=r"supervisor\.sqlite: no such table: notes"):
        store.get_note("a")
    with pytest.raises(StoreError, match="free space and permissions"):
        store.set_note("a", "b")


def test_a_file_that_is_not_a_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "jobs.sqlite"
    path.write_text("this is a text, and longer than the header of a data base would be\n" * 20)
    with pytest.raises(StoreError, match="move it away"):
        Store(path)


def test_a_store_opened_twice_keeps_its_log_when_another_program_closes(tmp_path: Path) -> None:
    """Closing a file releases all of a process's locks on it, including those of SQLite."""
    path = tmp_path / "journal.sqlite"
    first, second = Store(path), Store(path)
    other = f"""
from pathlib import Path
from pincette_supervisor.journal.store import Store
Store(Path({str(path)!r})).close()
"""
    subprocess.run([sys.executable, "-c", other], check=True, timeout=60.0)
    assert path.with_name(f"{path.name}-wal").exists()
    for one in (second, first):
        one.close()
