"""A journal of any age is brought to the tables of today, or left as it was."""

import json
import sqlite3
import subprocess
import sys
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from pincette_supervisor.journal.migrate import MIGRATIONS
from pincette_supervisor.journal.store import ActionRow, JobRow, Store, StoreError
from pincette_supervisor.journal.tables import METADATA

AT = "2026-03-01T12:00:00.000Z"
HEAD = sorted((MIGRATIONS / "versions").glob("v*.py"))[-1].name[1:5]
"""The newest revision, by the names of the files."""
HAND_MADE = """
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, kind TEXT NOT NULL, rig TEXT NOT NULL, state TEXT NOT NULL,
    cause TEXT NOT NULL, request TEXT NOT NULL, plan TEXT NOT NULL, result TEXT,
    created_at TEXT NOT NULL, started_at TEXT, ended_at TEXT
) STRICT;
CREATE TABLE actions (
    job TEXT NOT NULL REFERENCES jobs (id), number INTEGER NOT NULL, type TEXT NOT NULL,
    requested_at TEXT NOT NULL, requested_by TEXT NOT NULL, seq INTEGER,
    PRIMARY KEY (job, number)
) STRICT;
CREATE TABLE notes (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
PRAGMA user_version = 1;
"""
"""As the program made them before there were migrations."""


def old_file(path: Path, jobs: Iterable[tuple[str, str, str]]) -> Path:
    """A file of before, with jobs by name, plan and time."""
    with closing(sqlite3.connect(path)) as base:
        base.executescript(HAND_MADE)
        for name, plan, at in jobs:
            base.execute(
                "INSERT INTO jobs VALUES (?, 'grip', 'demo', 'succeeded', '', ?, ?, ?, ?, ?, ?)",
                (name, json.dumps({"kind": "grip"}), plan, '{"peak_force_mN": 20.5}', at, at, at),
            )
            base.execute("INSERT INTO actions VALUES (?, 0, 'start', ?, 'me', 7)", (name, at))
        base.execute("INSERT INTO notes VALUES ('actuator_met', '17')")
        base.commit()
    return path


def test_jobs_of_before_are_found(tmp_path: Path) -> None:
    later, earlier = "2026-03-01T12:00:09.000Z", AT
    path = old_file(
        tmp_path / "jobs.sqlite", [("b", '{"values": {}}', later), ("a", "{}", earlier)]
    )
    store = Store(path)
    assert [(job.id, job.number) for job in store.newest(9)] == [("b", 2), ("a", 1)]
    assert store.get("b") == JobRow(
        id="b",
        kind="grip",
        rig="demo",
        state="succeeded",
        request={"kind": "grip"},
        plan={"values": {}},
        created_at=later,
        result={"peak_force_mN": 20.5},
        started_at=later,
        ended_at=later,
        actions=(ActionRow("start", later, "me", 7),),
        number=2,
        revision=1,
    )
    assert store.noted("actuator_met") == "17"
    assert store.add(JobRow("c", "grip", "demo", "queued", {}, {}, AT)).number == 3
    store.close()
    again = Store(path)
    assert len(again.newest(9)) == 3
    again.close()


@pytest.mark.parametrize("old", [True, False], ids=["upgraded", "made"])
def test_migrated_tables_are_those_of_the_program(tmp_path: Path, old: bool) -> None:
    path = tmp_path / "jobs.sqlite"
    store = Store(old_file(path, [("a", "{}", AT)]) if old else path)
    with store.reading() as base:
        context = MigrationContext.configure(base)
        assert context.get_current_revision() == HEAD
        assert compare_metadata(context, METADATA) == []
    store.close()


def test_a_migration_that_fails_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    path = old_file(tmp_path / "jobs.sqlite", [("a", "{}", AT), ("b", "{cut", AT)])
    for _ in range(2):
        with pytest.raises(StoreError, match=r"jobs\.sqlite cannot be used.*move it away"):
            Store(path)
    with closing(sqlite3.connect(path)) as base:
        tables = base.execute("SELECT name FROM sqlite_schema WHERE type = 'table'").fetchall()
        assert sorted(tables) == [("actions",), ("jobs",), ("notes",)]
        assert base.execute("SELECT count(*) FROM jobs").fetchone() == (2,)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("UPDATE alembic_version SET version_num = '9999'", f"has schema 9999.*knows {HEAD}"),
        ("PRAGMA user_version = 5", f"has schema 5.*knows {HEAD}"),
    ],
)
def test_a_journal_of_a_newer_program_is_refused(tmp_path: Path, change: str, words: str) -> None:
    path = tmp_path / "jobs.sqlite"
    Store(path).close()
    with closing(sqlite3.connect(path)) as base:
        base.execute(change)
        base.commit()
    with pytest.raises(StoreError, match=words):
        Store(path)


def test_programs_of_before_refuse_the_file(tmp_path: Path) -> None:
    path = tmp_path / "jobs.sqlite"
    Store(path).close()
    with closing(sqlite3.connect(path)) as base:
        assert base.execute("PRAGMA user_version").fetchone() == (2,)


def test_migrating_says_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    Store(old_file(tmp_path / "jobs.sqlite", [("a", "{}", AT)])).close()
    assert capfd.readouterr() == ("", "")


def test_a_start_says_nothing_of_migrations(tmp_path: Path) -> None:
    script = (
        "import logging, pathlib\n"
        "logging.basicConfig(level=logging.INFO)\n"
        "from pincette_supervisor.journal.store import Store\n"
        f"Store(pathlib.Path({str(tmp_path / 'journal.sqlite')!r})).close()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60.0, check=True
    )
    assert (done.stdout, done.stderr) == ("", "")
