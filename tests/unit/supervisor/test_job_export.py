"""The table of all jobs: complete, whatever their number, in memory that does not grow with it."""

import asyncio
import csv
import gc
import io
import json
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, cast

import pyarrow.parquet as untyped_parquet
import pytest

from pincette.records import parquet
from pincette_supervisor.journal import store as journal_store
from pincette_supervisor.journal.job_filter import EVERY_JOB, JobFilter
from pincette_supervisor.journal.tables import TableRow
from pincette_supervisor.results import job_table

from .harness import Harness
from .streams import Stream

arrow_parquet: Any = untyped_parquet
PAGE = 25
"""Jobs read at once in these tests; a supervisor reads ten times as many."""
FEW, MANY = 2 * PAGE, 8 * PAGE
MEASURED, LISTED, ROUNDS = 2000, 200, 3
"""Jobs whose export is measured, jobs on one page of the list, and measurements."""
LEAST_TIMES = 2.0
"""Least processor time of a table from the list of jobs, as a multiple of that of an export."""

LONG_S = 60.0
NUMBERS = "export.numbers.csv"
FORMS = [job_table.csv_of, job_table.numbers_of, job_table.parquet_of]


@pytest.fixture
def journal(harness: Harness, monkeypatch: pytest.MonkeyPatch) -> Harness:
    """Make a journal of many pages of jobs."""
    monkeypatch.setattr(journal_store, "PAGE", PAGE)
    add_jobs(harness, MANY)
    return harness


def add_jobs(harness: Harness, count: int) -> None:
    """Add ended jobs to a journal, each with a result of different size."""
    job = str(harness.grip()["id"])
    harness.freed(job)
    store = harness.manager.context.store
    row = store.get(job)
    assert row is not None
    with store.writing():
        for number in range(count - 1):
            name = f"{job}-{number}"
            store.add(replace(row, id=name, sample=f"B{number}", actions=()))
            store.change(name, result={**(row.result or {}), "extra_mN": 0.5 * number})


def test_every_job_is_in_the_table(journal: Harness, tmp_path: Path) -> None:
    rows = list(csv.DictReader(journal.call("GET", "/api/v1/jobs/export.csv").text.splitlines()))
    assert len(rows) == len({row["id"] for row in rows}) == MANY
    assert float(rows[0]["result.extra_mN"]) == 0.5 * (MANY - 2)
    assert rows[-1]["result.extra_mN"] == ""  # the first job has no such figure
    path = tmp_path / "jobs.parquet"
    path.write_bytes(journal.call("GET", "/api/v1/jobs/export.parquet").content)
    table = parquet.opened(path).read()
    assert table["id"].to_pylist() == [row["id"] for row in rows]
    assert table.schema.field("result.extra_mN").metadata[b"unit"] == b"mN"
    limited = journal.call("GET", f"/api/v1/jobs/export.csv?limit={PAGE + 3}").text
    assert len(limited.splitlines()) == 1 + PAGE + 3


def test_the_table_of_numbers_is_described_by_its_metadata(
    journal: Harness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_table, "MOST_WORDS", 10)  # fewer than there are samples
    path = "/api/v1/jobs/export"
    text = {row["id"]: row for row in table(journal, f"{path}.csv")}
    rows = table(journal, f"{path}.numbers.csv")
    tree = journal.call("GET", f"{path}.numbers.csv-metadata.json").json()
    described = {column["titles"]: column for column in tree["tableSchema"]["columns"]}
    words = {
        name: {one["schema:value"]: one["schema:name"] for one in column["schema:valueReference"]}
        for name, column in described.items()
        if "schema:valueReference" in column
    }
    assert list(described) == list(rows[0])
    (left_out,) = tree["schema:additionalProperty"]
    assert "sample" in left_out["schema:value"].split(", ")
    assert [int(row["id"]) for row in rows] == [*range(MANY, 0, -1)]  # from the oldest job on
    for row in rows:
        plain = text[words["id"][int(row["id"])]]
        assert words["kind"][int(row["kind"])] == plain["kind"]
        created_at = datetime.fromisoformat(plain["created_at"])
        assert float(row["created_at"]) == created_at.timestamp()
        assert row["result.force_held_mN"] == plain["result.force_held_mN"]
        assert row["result.extra_mN"] == (plain["result.extra_mN"] or "nan")
        assert {value for value in row.values() if not is_number(value)} == set()


def table(journal: Harness, path: str) -> list[dict[str, str]]:
    return list(csv.DictReader(journal.call("GET", path).text.splitlines()))


def is_number(text: str) -> bool:
    with suppress(ValueError):
        float(text)
        return True
    return False


def rows_of(*results: dict[str, Any]) -> list[TableRow]:
    """Return rows of jobs of one kind with these results, the newest first."""
    return [
        TableRow((f"j-{number}", "demo", "grip", *[None] * 10), "{}", "null", json.dumps(result))
        for number, result in enumerate(results)
    ]


def test_results_of_any_structure_are_exported_as_columns() -> None:
    rows = rows_of(
        {"a": 1, "of": {"x_um": 0.1, "deep": {"yes": True}}, "list": [1, {"a": 2}]},
        {"a": 2.5, "of": None, "list": None, "new": "=1+1"},
        {"a": "word", "of": "word", 'a "key"': None, "list": {"b": 3}},
        {},
    )
    text = b"".join(job_table.csv_of(lambda: iter([rows]))).decode()
    found = list(csv.DictReader(io.StringIO(text)))
    names = ("a", "of", "of.x_um", "of.deep.yes", "list.b", "new", 'a "key"')
    expected = [
        ("1", "", "0.1", "true", "", "", ""),
        ("2.5", "", "", "", "", "'=1+1", ""),
        ("word", "word", "", "", "3", "", ""),
        ("",) * 7,
    ]
    assert [tuple(row[f"result.{name}"] for name in names) for row in found] == expected


ODD = {
    "a,b;c": "=1+1",
    "a.b": "two\nlines, \r\nand more",
    "=@#": '"quoted"',
    "result.a": "-1",
    "µ夹": "\x0b \x85 \u2028 🦠",
    "A": "",
    "a": " null, true ",
}
"""Labels of a job that are no plain words."""


def test_odd_labels_are_unchanged_in_every_form() -> None:
    (plain,) = rows_of({"a": 1.5, "b": True})
    rows = [plain._replace(labels=json.dumps(ODD)), plain]
    wanted = {f"label.{name}": text for name, text in ODD.items()}

    def content(form: Callable[[job_table.Rows], Iterator[bytes]]) -> bytes:
        return b"".join(form(lambda: iter([rows])))

    first, second = csv.DictReader(io.StringIO(content(job_table.csv_of).decode(), newline=""))
    formulas = {name: f"'{text}" for name, text in wanted.items() if text[:1] in ("=", "-")}
    assert {name: first[name] for name in wanted} == {**wanted, **formulas}
    assert {second[name] for name in wanted} == {""}
    parquet_table = arrow_parquet.read_table(io.BytesIO(content(job_table.parquet_of)))
    for name, text in wanted.items():
        assert parquet_table[name].to_pylist() == [text, None]
    numbers = list(csv.DictReader(io.StringIO(content(job_table.numbers_of).decode())))
    parts = job_table.metadata_of(lambda: iter([rows]), NUMBERS)
    columns = json.loads(b"".join(parts))["tableSchema"]["columns"]
    assert [column["titles"] for column in columns] == list(numbers[0])
    for column in columns:
        if column["titles"] in wanted:
            assert column["schema:valueReference"] == [
                {"schema:name": wanted[column["titles"]], "schema:value": 1}
            ]
    assert [[row[name] for name in wanted] for row in numbers] == [["1"] * 7, ["nan"] * 7]
    assert [row["result.a"] for row in numbers] == ["1.5", "1.5"]


@pytest.fixture
def berlin(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with monkeypatch.context() as patched:
        patched.setenv("TZ", "Europe/Berlin")
        time.tzset()
        yield
    time.tzset()


@pytest.mark.usefixtures("berlin")
def test_times_in_a_repeated_hour_stay_an_hour_apart() -> None:
    times = ["2025-10-26T01:30:00.000Z", "2025-10-26T00:30:00.000Z"]
    rows = [
        row._replace(fixed=(*row.fixed[:4], at, *row.fixed[5:]))
        for row, at in zip(rows_of({}, {}), times, strict=True)
    ]

    def column(form: Callable[[job_table.Rows], Iterator[bytes]]) -> list[str]:
        text = b"".join(form(lambda: iter([rows]))).decode()
        return [row["created_at"] for row in csv.DictReader(io.StringIO(text))]

    assert column(job_table.csv_of) == times
    later_s, earlier_s = map(float, column(job_table.numbers_of))
    assert later_s - earlier_s == 3600.0


@pytest.mark.parametrize("form", FORMS)
def test_a_job_that_changes_between_the_two_passes_keeps_the_columns(
    form: Callable[[job_table.Rows], Iterator[bytes]],
) -> None:
    before, after = {"a": 1.5, "b": True}, {"a": "word", "b": False, "c": 1}
    readings = iter([rows_of(before, before), rows_of(before, after)])
    content = b"".join(form(lambda: iter([next(readings)])))
    if form is job_table.parquet_of:
        table = arrow_parquet.read_table(io.BytesIO(content))
        assert table["result.a"].to_pylist() == [1.5, None]
        assert table["result.b"].to_pylist() == [True, False]
    else:
        first, last = [line.split(",")[-2:] for line in content.decode().split()[1:]]
        yes, no, none = ("true", "false", "") if form is job_table.csv_of else ("1", "0", "nan")
        assert (first, last) == (["1.5", yes], [none, no])


def counted_pages(journal: Harness, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that grows with each page that is read from the journal."""
    read = list[int]()
    table_pages = journal.store.table_pages

    def counted(found: JobFilter, limit: int | None) -> Iterator[list[TableRow]]:
        for page in table_pages(found, limit):
            read.append(len(page))
            yield page

    monkeypatch.setattr(journal.store, "table_pages", counted)
    return read


@pytest.mark.parametrize("form", FORMS)
def test_the_first_bytes_do_not_wait_for_the_journal(
    journal: Harness,
    monkeypatch: pytest.MonkeyPatch,
    form: Callable[[job_table.Rows], Iterator[bytes]],
) -> None:
    read = counted_pages(journal, monkeypatch)
    assert next(form(journal.rigs.table_rows(EVERY_JOB)))
    assert read == []


@pytest.mark.parametrize(
    ("pages", "paths"),
    [
        (1, ["export.csv", NUMBERS, "export.parquet", f"{NUMBERS}-metadata.json"]),
        (MANY // PAGE + 2, ["export.csv", NUMBERS, "export.parquet"]),
    ],
    ids=["while the columns are searched", "while the rows are sent"],
)
def test_a_disconnected_client_ends_the_export(
    journal: Harness, monkeypatch: pytest.MonkeyPatch, pages: int, paths: list[str]
) -> None:
    table_pages = journal.store.table_pages
    for path in paths:
        with monkeypatch.context() as patched:
            reader = HeldReader(table_pages, pages)
            patched.setattr(journal.store, "table_pages", reader.table_pages)
            asyncio.run(disconnect(journal, path, reader))
        assert reader.unfinished == 0, path
        assert reader.read < pages + 2, path


class HeldReader:
    """Reader of the journal that waits with one of the pages."""

    def __init__(
        self, table_pages: Callable[[JobFilter, int | None], Iterator[list[TableRow]]], held: int
    ) -> None:
        self._table_pages, self._held = table_pages, held
        self.read = self.unfinished = 0
        self.reached, self.released = threading.Event(), threading.Event()

    def table_pages(self, found: JobFilter, limit: int | None) -> Iterator[list[TableRow]]:
        self.unfinished += 1
        try:
            for page in self._table_pages(found, limit):
                self.read += 1
                if self.read == self._held:
                    self.reached.set()
                    assert self.released.wait(LONG_S)
                yield page
        finally:
            self.unfinished -= 1


async def disconnect(journal: Harness, path: str, reader: HeldReader) -> None:
    """Disconnect from an export while its reader waits."""
    async with Stream(journal.app, f"/api/v1/jobs/{path}"):
        assert await asyncio.to_thread(reader.reached.wait, LONG_S)
        asyncio.get_running_loop().call_later(0.0, reader.released.set)


@pytest.mark.parametrize("form", FORMS)
def test_memory_of_an_export_does_not_grow_with_the_jobs(
    journal: Harness, form: Callable[[job_table.Rows], Iterator[bytes]]
) -> None:
    rigs = journal.rigs

    def peak_bytes(jobs: int) -> int:
        gc.collect()
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        for _ in form(rigs.table_rows(EVERY_JOB, jobs)):
            gc.collect()  # types of rows are in reference cycles
        return tracemalloc.get_traced_memory()[1] - before

    tracemalloc.start()
    try:
        peak_bytes(MANY)  # the interpreter enlarges its table of names once, by some MB
        few, many = peak_bytes(FEW), peak_bytes(MANY)
    finally:
        tracemalloc.stop()
    assert many < 1.5 * few, f"{few / 1e6:.1f} MB for {FEW} jobs, {many / 1e6:.1f} MB for {MANY}"


@pytest.mark.slow
def test_an_export_takes_less_processor_time_than_the_same_table_from_pages(
    harness: Harness,
) -> None:
    add_jobs(harness, MEASURED)

    def exported() -> list[dict[str, str]]:
        return table(harness, "/api/v1/jobs/export.csv")

    def listed() -> list[dict[str, str]]:
        jobs = [columns_of(job) for job in pages(harness)]
        names = dict.fromkeys(name for job in jobs for name in job)
        text = io.StringIO()
        writer = csv.DictWriter(text, list(names))
        writer.writeheader()
        writer.writerows(jobs)
        return list(csv.DictReader(io.StringIO(text.getvalue())))

    def time_s(make: Callable[[], list[dict[str, str]]]) -> float:
        begun_s = time.process_time()
        assert len(make()) == MEASURED
        return time.process_time() - begun_s

    assert [row["id"] for row in exported()] == [row["id"] for row in listed()]
    measured = [(time_s(exported), time_s(listed)) for _ in range(ROUNDS)]
    export_s, pages_s = (min(values) for values in zip(*measured, strict=True))
    print(f"rows per processor second: {MEASURED / export_s:.0f}, pages {MEASURED / pages_s:.0f}")
    assert pages_s > LEAST_TIMES * export_s


def pages(harness: Harness) -> Iterator[dict[str, Any]]:
    """Yield all jobs, read page by page."""
    path = f"/api/v1/jobs?limit={LISTED}"
    query = ""
    while True:
        page = harness.call("GET", f"{path}{query}").json()
        yield from page["jobs"]
        if page["next"] is None:
            return
        query = f"&before={page['next']}"


def columns_of(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the members of a job as columns, those of objects by their path."""
    found: dict[str, Any] = {}
    for name, value in tree.items():
        if isinstance(value, dict):
            found |= columns_of(cast("dict[str, Any]", value), f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found
