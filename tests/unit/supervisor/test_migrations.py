"""A new journal has the tables of the models; a journal of another schema is left as it is."""

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import create_engine, inspect

from pincette_supervisor.journal.database import MIGRATIONS
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.journal.tables import METADATA

HEAD = sorted((MIGRATIONS / "versions").glob("v*.py"))[-1].name[1:5]
"""The newest revision, by the names of the files."""


def is_model(name: str | None, *_: object) -> bool:
    return "job_search" not in (name or "")


def test_migrated_tables_are_those_of_the_models(tmp_path: Path) -> None:
    store = Store(tmp_path / "jobs.sqlite")
    made = create_engine("sqlite://")
    METADATA.create_all(made)
    with store.reading() as migrated, made.begin() as modelled:
        # The full-text index is a virtual table with tables of its own, which are no models.
        context = MigrationContext.configure(
            migrated,
            opts={"include_name": is_model},
        )
        assert context.get_current_revision() == HEAD
        assert compare_metadata(context, METADATA) == []
        found, expected = inspect(migrated), inspect(modelled)
        for table in METADATA.tables:
            assert str(found.get_columns(table)) == str(expected.get_columns(table))
            assert found.get_indexes(table) == expected.get_indexes(table)
            assert found.get_foreign_keys(table) == expected.get_foreign_keys(table)
            assert found.get_pk_constraint(table) == expected.get_pk_constraint(table)
    made.dispose()
    store.close()


def test_a_reopened_journal_is_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "jobs.sqlite"
    store = Store(path)
    store.set_note("actuator_met", "17")
    store.close()
    again = Store(path)
    assert again.get_note("actuator_met") == "17"
    again.close()


@pytest.mark.parametrize("revision", ["9999", "0008"], ids=["newer", "unreleased"])
def test_a_journal_of_another_schema_is_refused(tmp_path: Path, revision: str) -> None:
    path = tmp_path / "jobs.sqlite"
    Store(path).close()
    with closing(sqlite3.connect(path)) as base:
        base.execute("UPDATE alembic_version SET version_num = ?", (revision,))
        base.commit()
    words = rf"jobs\.sqlite has schema {revision}, this program knows {HEAD}: use the version"
    for _ in range(2):
        with pytest.raises(StoreError, match=words):
            Store(path)


def test_a_journal_without_a_revision_is_refused_and_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "jobs.sqlite"
    with closing(sqlite3.connect(path)) as base:
        base.execute("CREATE TABLE jobs (id TEXT PRIMARY KEY)")
        base.commit()
    with pytest.raises(StoreError, match=r"has a schema without a number.*move it away"):
        Store(path)
    with closing(sqlite3.connect(path)) as base:
        tables = base.execute("SELECT name FROM sqlite_schema WHERE type = 'table'").fetchall()
    assert tables == [("jobs",)]


def test_a_migration_prints_nothing(tmp_path: Path) -> None:
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
