"""The journal in a real PostgreSQL server: the same as in a file."""

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from pincette.config import RigFile
from pincette_supervisor.journal.access import (
    AuditRepository,
    AuditRow,
    SessionRepository,
    SessionRow,
)
from pincette_supervisor.journal.events import AlarmRepository, AlarmRow
from pincette_supervisor.journal.library import RecipeRepository
from pincette_supervisor.journal.store import Store, StoreError
from pincette_supervisor.journal.tables import METADATA, utc_now
from tests.support.postgres import Server, server

from .canned import IN_HOLD
from .harness import Harness
from .test_job_search import FILTERS, fill, matches, rows

NUMBERS = count(1)


@pytest.fixture(scope="module")
def postgres() -> Iterator[Server]:
    with server() as made:
        yield made


@pytest.fixture
def url(postgres: Server) -> str:
    return postgres.database(f"bench{next(NUMBERS)}")


@pytest.fixture
def store(tmp_path: Path, url: str) -> Iterator[Store]:
    made = Store(tmp_path / "supervisor.sqlite", url)
    yield made
    made.close()


def is_model(name: str | None, *_: object) -> bool:
    return not (name or "").startswith("ix_jobs_search_")


def test_the_postgresql_tables_match_the_models_and_no_file_is_created(
    store: Store, tmp_path: Path
) -> None:
    with store.reading() as connection:
        # Indexes of expressions are no part of the models.
        context = MigrationContext.configure(
            connection,
            opts={"include_name": is_model},
        )
        assert compare_metadata(context, METADATA) == []
    assert list(tmp_path.iterdir()) == []


def test_a_job_is_run_and_found_again_with_its_events(
    rig_file: RigFile, open_harness: Callable[..., Harness], url: str
) -> None:
    harness = open_harness(rig_file, store_url=url)
    body = {"sample": "Größe B7", "labels": {"tray": "7", "odd": "a\0b"}, "notes": "with\0nul"}
    job = harness.grip(**body)["id"]
    ended = harness.ended(job)
    assert ended["state"] == "succeeded"
    assert ended["notes"] == "with\N{REPLACEMENT CHARACTER}nul"
    other = harness.grip()["id"]
    harness.ended(other)
    for query in ({"text": "E B7"}, {"label": "tray=7"}, {"text": "TRAY"}, {"sample": "Größe B7"}):
        found = harness.get("/jobs", **query)["jobs"]
        assert [one["id"] for one in found] == [job], query
    assert len(harness.get("/jobs", outcome="gripped")["jobs"]) == 2
    numbers = [event.number or 0 for event in harness.told()]
    assert numbers == sorted(set(numbers))
    assert (
        harness.post("/recipes", {"name": "bead", "values": {"force_mN": 8.0}}).status_code == 201
    )


def test_a_search_finds_the_same_jobs_as_a_check_of_each_job(store: Store) -> None:
    fill(store, rows())
    for wanted in FILTERS:
        expected = [job.id for job in reversed(rows()) if matches(job, wanted)]
        assert [job.id for job in store.newest(500, wanted)] == expected, wanted


def test_a_search_has_indexes(store: Store) -> None:
    with store.reading() as connection:
        found = connection.scalars(text("SELECT indexname FROM pg_indexes"))
        names = {name for name in found if name.startswith("ix_jobs_search_")}
    assert names == {f"ix_jobs_search_{name}" for name in ("outcome", "labels", "words")}


def test_the_audit_log_is_append_only(store: Store) -> None:
    audit = AuditRepository(store)
    row = AuditRow(at=utc_now(), who="a", address="b", action="c", detail="d", status=200)
    audit.add([row, row])
    audit.add([row])
    assert audit.chain().broken is None
    for order in (
        "UPDATE audit SET who = 'x'",
        "DELETE FROM audit WHERE number = 2",
        "TRUNCATE audit",
    ):
        with pytest.raises((StoreError, DBAPIError), match="audit log"), store.writing() as writer:
            writer.execute(text(order))
    assert audit.chain().entries == 3


def test_sessions_alarms_and_recipes_are_stored(store: Store) -> None:
    sessions, session = SessionRepository(store), SessionRow("b" * 64, "a" * 64, utc_now())
    sessions.sign_in(session)
    assert sessions.all() == [session]
    sessions.sign_out(session.digest)
    assert sessions.all() == []
    alarms = AlarmRepository(store)
    row = AlarmRow("demo", "disk", "full", utc_now(), "warning", "condition", None)
    assert [alarms.add(row).count for _ in range(2)] == [1, 2]
    recipes = RecipeRepository(store)
    versions = [recipes.add("bead", {"force_mN": value}, "")[0].version for value in (8.0, 9.0)]
    assert versions == [1, 2]


def test_a_restart_of_the_server_loses_nothing(
    rig_file: RigFile, open_harness: Callable[..., Harness], postgres: Server, url: str
) -> None:
    harness = open_harness(rig_file, store_url=url)
    job = harness.playing_to(IN_HOLD)
    postgres.stop()
    try:
        assert not harness.store.probe()
        assert "the server runs" in harness.store.trouble
        harness.bus.play()
        live = harness.live
        harness.until(lambda: live.status.terminal)
    finally:
        postgres.start()
    harness.until(harness.manager.context.write_queue.flush)
    assert harness.ended(job)["state"] == "succeeded"


def test_two_supervisors_do_not_share_a_database(store: Store, tmp_path: Path, url: str) -> None:
    store.work_alone()
    other = Store(tmp_path / "other" / "supervisor.sqlite", url)
    with pytest.raises(StoreError, match="another supervisor uses it"):
        other.work_alone()
    store.close()
    other.work_alone()
    other.close()


@pytest.mark.parametrize(
    "odd", ["mysql://host/x", "nothing", "postgresql://u:secret@/x?host=/none"]
)
def test_an_unreachable_server_is_reported_without_its_password(tmp_path: Path, odd: str) -> None:
    with pytest.raises(StoreError) as refused:
        Store(tmp_path / "supervisor.sqlite", odd)
    assert "secret" not in str(refused.value)
