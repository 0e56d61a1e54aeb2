"""How the journal finds its rows: frequent queries read no table from end to end."""

from typing import Any

import pytest
from sqlalchemy import Select, event, text
from sqlalchemy.dialects import sqlite
from sqlalchemy.engine import Engine

from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import Store, utc_now


def plan(store: Store, query: str) -> list[str]:
    with store.reading() as connection:
        found = connection.execute(text(f"EXPLAIN QUERY PLAN {query}")).all()
    return [str(row[3]) for row in found]


def as_text(query: Select[Any]) -> str:
    return str(query.compile(dialect=sqlite.dialect(), compile_kwargs={"literal_binds": True}))


def newest(wanted: JobFilter) -> str:
    return as_text(wanted.newest(51, "sqlite"))


BY_COLUMN = (
    JobFilter(rig="demo"),
    JobFilter(state="running"),
    JobFilter(kind="grip"),
    JobFilter(sample="B7"),
    JobFilter(batch="w12"),
    JobFilter(operator="ann"),
    JobFilter(pinned=True),
    JobFilter(rig="demo", created_from="2026-03-01", created_to="2026-03-02"),
)
BY_WORDS = (
    JobFilter(outcome="gripped"),
    JobFilter(label=("tray", "7")),
    JobFilter(text="chip"),
    JobFilter(text="ch"),
    JobFilter(text="chip", outcome="gripped", rig="demo", before_number=9),
)
BY_TIME = (
    JobFilter(created_from="2026-03-01"),
    JobFilter(created_to="2026-03-01"),
    JobFilter(created_from="2026-03-01", created_to="2026-03-02", before_number=9),
)
BY_SEVERAL = (
    JobFilter(rig="demo", state="succeeded"),
    JobFilter(rig="demo", state="succeeded", before_number=9),
    JobFilter(kind="grip", state="failed", rig="demo"),
    JobFilter(kind="grip", pinned=True, created_from="2026-03-01"),
)


@pytest.mark.parametrize("wanted", BY_COLUMN)
def test_a_list_uses_an_index_and_sorts_nothing(store: Store, wanted: JobFilter) -> None:
    (step,) = plan(store, newest(wanted))
    assert step.startswith("SEARCH jobs USING INDEX ix_jobs_"), step


@pytest.mark.parametrize("wanted", BY_WORDS)
def test_a_search_reads_only_jobs_of_the_full_text_index(store: Store, wanted: JobFilter) -> None:
    index, step = plan(store, newest(wanted))
    assert index.startswith("SCAN job_search VIRTUAL TABLE"), index
    assert step.startswith("SEARCH jobs USING INDEX"), step


@pytest.mark.parametrize("wanted", BY_TIME)
def test_a_filter_by_time_reads_times_in_an_index(store: Store, wanted: JobFilter) -> None:
    (step,) = plan(store, newest(wanted))
    assert "jobs USING INDEX ix_jobs_number_created_at" in step, step


@pytest.mark.parametrize("wanted", BY_SEVERAL)
def test_a_filter_by_several_columns_reads_one_index(store: Store, wanted: JobFilter) -> None:
    jobs, _, numbers = plan(store, newest(wanted))
    assert jobs.startswith("SEARCH jobs USING INDEX"), jobs
    assert "jobs USING COVERING INDEX ix_jobs_listed" in numbers, numbers


def test_a_filter_by_a_sample_and_more_uses_the_index_of_the_sample(store: Store) -> None:
    wanted = JobFilter(rig="demo", kind="grip", sample="B7", before_number=9)
    *_, numbers = plan(store, newest(wanted))
    assert numbers.startswith("SEARCH jobs USING INDEX ix_jobs_sample_number"), numbers


def test_frequent_queries_read_no_job_and_no_event(store: Store) -> None:
    requests: list[str] = []

    def note(_c: Any, _cursor: Any, statement: str, values: Any, *_: Any) -> None:
        for value in values:
            statement = statement.replace("?", repr(value), 1)
        if statement.startswith("SELECT"):
            requests.append(statement)

    event.listen(Engine, "before_cursor_execute", note)
    try:
        store.counted()
        store.queued("demo")
        store.event_span()
        store.events_after(5)
        store.events_after(5, job="j-1")
        store.interrupt_unfinished(utc_now())
    finally:
        event.remove(Engine, "before_cursor_execute", note)
    assert len(requests) >= 6
    for statement in requests:
        for step in plan(store, statement):
            whole = step.startswith(("SCAN jobs", "SCAN events", "SCAN actions"))
            assert not whole or "COVERING INDEX" in step, (statement, step)
