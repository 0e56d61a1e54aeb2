"""Searches in the journal find the same jobs as a check of each job, and are as fast with more
jobs."""

import string
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import thread_time

import pytest
from sqlalchemy import insert, text

from pincette_supervisor.journal.database import columns
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import JobRow, Store
from pincette_supervisor.journal.tables import JOBS
from tests.support.stores import open_store

AT = "2026-03-01T12:00:00.000Z"
BASE = JobRow("", "grip", "demo", "succeeded", {}, {"values": {}}, AT)
ODD = (
    'a"b',
    "100 %",
    "a_b",
    "Größe B7",
    "\N{PINCHING HAND} NEAR(x",
    "col: -x*",
    "AND",
    "a\\b",
    "'",
)
"""Texts with characters that are special in SQL, JSON or full-text queries."""
TEXTS = (*ODD, "gr", "B7", "b7", "7", "o", "_", "%", '"', "needle", "tray", '"tray": "7"', "AND OR")
LABELS = (("tray", "7"), ("tray", ""), ("t", "7"), ("ray", "7"), *(("odd", one) for one in ODD))


def rows() -> list[JobRow]:
    """Return jobs with different texts, labels, outcomes and times."""
    made = [
        replace(BASE, id="j-sample", sample="Größe B7", labels={"tray": "7"}),
        replace(BASE, id="j-labels", labels={"tray": "", "x": "tray"}, requested_by="cell-7"),
        replace(BASE, id="j-pinned", pinned=True, result={"outcome": "gripped"}),
        replace(BASE, id="j-cause", cause="dropped: B7", result={"outcome": "dropped"}),
        replace(BASE, id="j-notes", notes='of "outcome": "lost"', result={"samples": 3}),
    ]
    for number, odd in enumerate(ODD):
        made.append(replace(BASE, id=f"j-{number}-notes", notes=f"first {odd} last"))
        made.append(replace(BASE, id=f"j-{number}-label", labels={"odd": odd}, batch=odd))
    return [
        replace(job, number=number, created_at=f"2026-03-{28 - number:02d}T00:00:00.000Z")
        for number, job in enumerate(made, start=1)
    ]


def folded(words: str) -> str:
    """Return a text without the case of ASCII letters."""
    return words.translate(str.maketrans(string.ascii_uppercase, string.ascii_lowercase))


def matches(job: JobRow, wanted: JobFilter) -> bool:
    """Check a job itself; labels of ``TEXTS`` are searched by their own texts."""
    if wanted.text is not None:
        labels = [
            part
            for name, value in job.labels.items()
            for part in (name, value, f'"{name}": "{value}"')
        ]
        stated = [job.id, job.cause, job.requested_by or "", job.sample, job.batch, job.operator]
        places = [*stated, job.notes, *labels, '"' * bool(job.labels)]
        return any(folded(wanted.text) in folded(place) for place in places)
    if wanted.label is not None:
        name, value = wanted.label
        return job.labels.get(name) == value
    if wanted.outcome is not None:
        return (job.result or {}).get("outcome") == wanted.outcome
    columns = ("kind", "state", "rig", "sample", "batch")
    if any(getattr(wanted, name) not in (None, getattr(job, name)) for name in columns):
        return False
    early = wanted.created_from is not None and job.created_at < wanted.created_from
    late = wanted.created_to is not None and job.created_at >= wanted.created_to
    return not early and not late and wanted.pinned in (None, job.pinned)


FILTERS = (
    *(JobFilter(text=text) for text in TEXTS if text not in ('a"b', "a\\b")),
    *(JobFilter(label=label) for label in LABELS),
    *(JobFilter(outcome=name) for name in ("gripped", "dropped", "lost", "ripped", "null", "")),
    JobFilter(created_from="2026-03-20"),
    JobFilter(created_to="2026-03-20"),
    JobFilter(created_from="2026-03-10", created_to="2026-03-20"),
    JobFilter(created_to="2000"),
    JobFilter(pinned=True),
    JobFilter(kind="grip", pinned=True),
    JobFilter(kind="grip", pinned=False, created_to="2026-03-20"),
    JobFilter(rig="demo", state="failed"),
    JobFilter(rig="demo", state="succeeded", sample="Größe B7"),
)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    made = open_store(tmp_path_factory.mktemp("journal") / "supervisor.sqlite")
    fill(made, rows())
    yield made
    made.close()


def fill(store: Store, jobs: list[JobRow]) -> None:
    with store.writing() as connection:
        connection.execute(insert(JOBS), [columns(job, "actions") for job in jobs])


def found(store: Store, wanted: JobFilter) -> list[str]:
    return [job.id for job in store.newest(500, wanted)]


@pytest.mark.parametrize("wanted", FILTERS)
def test_a_search_finds_the_same_jobs_as_a_check_of_each_job(
    store: Store, wanted: JobFilter
) -> None:
    expected = [job.id for job in reversed(rows()) if matches(job, wanted)]
    assert found(store, wanted) == expected
    before = replace(wanted, before_number=9)
    assert found(store, before) == [
        job.id for job in reversed(rows()) if job.number < 9 and matches(job, wanted)
    ]


def test_a_search_follows_each_change_of_a_job(tmp_path: Path) -> None:
    store = Store(tmp_path / "supervisor.sqlite")
    fill(store, [replace(BASE, id="a", number=1, state="running"), replace(BASE, id="b", number=2)])
    changes: tuple[tuple[dict[str, object], JobFilter], ...] = (
        ({"notes": "a needle"}, JobFilter(text="needle")),
        ({"sample": "B7"}, JobFilter(text="b7")),
        ({"labels": {"tray": "9"}}, JobFilter(label=("tray", "9"))),
        ({"labels": {"tray": "8"}}, JobFilter(label=("tray", "8"), text="tray")),
        ({"cause": "a slip"}, JobFilter(text="slip")),
        ({"result": {"outcome": "gripped"}}, JobFilter(outcome="gripped")),
        ({"pinned": True}, JobFilter(pinned=True)),
    )
    for change, wanted in changes:
        assert found(store, wanted) == []
        store.change("b", **change)
        assert found(store, wanted) == ["b"]
    assert found(store, JobFilter(label=("tray", "9"))) == []
    store.interrupt_unfinished(AT)
    assert found(store, JobFilter(text="supervisor ended")) == ["a"]
    with store.writing() as connection:
        connection.execute(text("DELETE FROM jobs WHERE id = 'b'"))
        assert connection.scalar(text("SELECT count(*) FROM job_search")) == 1
    store.close()


FEW, MANY = 500, 50_000
COMMON = replace(
    BASE,
    request={"kind": "grip"},
    plan={"values": {"force_mN": 8.0}, "phases": ["approach"] * 150},
    result={"outcome": "gripped", "figures": list(range(500))},
    labels={"tray": "7"},
    notes="glass bead of the second wafer",
)
COSTS = (
    JobFilter(),
    *(JobFilter(text=text) for text in ("needle", "glass bead", "filled", "second")),
    *(JobFilter(label=("tray", value)) for value in ("7", "8")),
    *(JobFilter(outcome=name) for name in ("gripped", "dropped")),
    *(JobFilter(created_from=time) for time in ("2000", "2040")),
    *(JobFilter(created_to=time) for time in ("2000", "2040")),
    *(JobFilter(pinned=pinned) for pinned in (False, True)),
    *(JobFilter(rig="demo", created_to=time) for time in ("2000", "2040")),
    JobFilter(sample="none"),
    JobFilter(rig="demo", kind="grip", state="failed"),
    JobFilter(kind="grip", sample="none"),
    JobFilter(state="succeeded", rig="other", created_from="2000"),
)


def test_a_list_costs_no_more_with_many_jobs(tmp_path: Path) -> None:
    stores = {count: Store(tmp_path / f"{count}.sqlite") for count in (FEW, MANY)}
    for count, store in stores.items():
        fill(store, [replace(COMMON, id=f"filled-{n}", number=n) for n in range(1, count + 1)])
    whole_s = least_s(stores[FEW], JobFilter())
    for wanted in COSTS:
        few_s, many_s = (least_s(store, wanted) for store in stores.values())
        # A few milliseconds for the times or words of all jobs are allowed, never for the jobs.
        assert many_s < 2.0 * few_s + 3.0 * whole_s, (wanted, few_s, many_s, whole_s)
    for store in stores.values():
        store.close()


def least_s(store: Store, wanted: JobFilter) -> float:
    """Return the least processor time for a list, of several attempts."""
    tries: list[float] = []
    for _ in range(7):
        begun_s = thread_time()
        store.newest(51, wanted)
        tries.append(thread_time() - begun_s)
    return min(tries)
