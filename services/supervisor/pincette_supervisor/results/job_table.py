"""Many jobs as one table: a row for each, a column for whatever any of them has."""

import csv
import io
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import IO, Any, cast

from pincette.api.jobs import Job
from pincette.core.units import unit_of
from pincette.records import number_table, parquet
from pincette.records.memory_file import MemoryFile

FIRST = ("id", "rig", "kind", "state", "created_at", "started_at", "ended_at", "by")
SAID = ("sample", "batch", "operator", "notes")
FIXED = (*FIRST, "ending", *SAID)
"""Columns of every table; they come first."""
TREES = {"label": "labels", "value": "values", "result": "result"}
"""Maps of a job by the begin of their columns' names, in the order of the columns."""
GROUP_ROWS = 2_000
"""Rows of a row group of a Parquet file."""
MAGIC = b"PAR1"
"""Begin of every Parquet file."""
EXACT: Mapping[parquet.Kind, frozenset[type[Any]]] = {
    "text": frozenset({str, type(None)}),
    "bool": frozenset({bool, type(None)}),
    "float": frozenset({float, type(None)}),
}
"""Types that a column holds as they are."""
TIMES = tuple(name for name in FIXED if name.endswith("_at"))
MOST_WORDS = 1_000
"""Different words of a column of numbers at most; a column with more, but ``id``, is left out."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Begins of texts that a spreadsheet would work out."""
Rows = Callable[[], Iterator[Sequence[Mapping[str, Any]]]]
"""Begins to read the jobs, a page at a time: their fixed columns and their maps, by name."""
Columns = Mapping[str, frozenset[type[Any]]]
"""Types of the values of each column, by its name."""


def row_of(job: Job) -> dict[str, Any]:
    """Return what a table takes from a job."""
    row: dict[str, Any] = {name: getattr(job, name) for name in (*FIRST, *SAID, *TREES.values())}
    row["ending"] = None if job.ending is None else job.ending.code
    return row


class _Flattener:
    """Names the values of maps in maps; each name is put together once."""

    def __init__(self) -> None:
        self._names: dict[str, dict[str, str]] = {}

    def flat(self, row: Mapping[str, Any]) -> dict[str, Any]:
        """Return every value that is neither list nor map, under the names of all that it is in."""
        found = {name: row[name] for name in FIXED}
        for begin, name in TREES.items():
            if tree := row[name]:
                self._add(begin, tree, found)
        return found

    def _add(self, begin: str, tree: Mapping[str, Any], found: dict[str, Any]) -> None:
        names = self._names.setdefault(begin, {})
        for key, value in tree.items():
            kind = value.__class__
            if kind is list:
                continue
            name = names.get(key)
            if name is None:
                name = names[key] = f"{begin}.{key}"
            if kind is dict:
                self._add(name, value, found)
            else:
                found[name] = value


@dataclass(frozen=True, slots=True)
class _Table:
    """The columns that were found, and what names the values of a row."""

    columns: Columns
    flattener: _Flattener

    def pages(self, rows: Rows) -> Iterator[list[dict[str, Any]]]:
        """Read the rows, flat, a page at a time."""
        for page in rows():
            yield [self.flattener.flat(row) for row in page]


class _Words:
    """The words of each column, numbered from the oldest job on."""

    def __init__(self) -> None:
        self._newest_first: dict[str, dict[str, None]] = {}

    def add(self, name: str, word: str) -> None:
        """Note a word of the next older job."""
        found = self._newest_first.setdefault(name, {})
        if len(found) <= MOST_WORDS or name == FIXED[0]:
            found.pop(word, None)
            found[word] = None

    def codes(self) -> dict[str, dict[str, int]]:
        """Return the number of each word, by the column, without columns of too many words."""
        return {
            name: {word: code for code, word in enumerate(reversed(found), start=1)}
            for name, found in self._newest_first.items()
            if len(found) <= MOST_WORDS or name == FIXED[0]
        }


def _scan(rows: Rows, words: _Words | None = None) -> Generator[bytes, None, _Table]:
    """Find the columns; yields nothing (``b""``) after each page, so that a client can hang up."""
    flattener = _Flattener()
    found: dict[str, set[type[Any]]] = {name: set() for name in FIXED}
    for page in rows():
        for row in page:
            for name, value in flattener.flat(row).items():
                kinds = found.get(name)
                if kinds is None:
                    kinds = found[name] = set()
                kinds.add(value.__class__)
                if words is not None and value.__class__ is str and name not in TIMES:
                    words.add(name, value)
        yield b""
    more = sorted([*found][len(FIXED) :], key=lambda name: [*TREES].index(name.partition(".")[0]))
    columns = {name: frozenset(found[name] - {type(None)}) for name in (*FIXED, *more)}
    return _Table(columns, flattener)


def csv_of(rows: Rows) -> Iterator[bytes]:
    """Yield parts of a CSV; a number reads back bit for bit, and no text is a formula.

    The jobs are read twice: for the columns and for the rows. The names of the fixed columns come
    at once. No more than a page of jobs is in memory.
    """
    yield ",".join(FIXED).encode()
    table = yield from _scan(rows)
    more = list(table.columns)[len(FIXED) :]
    yield (f",{_lines([more])}" if more else "\n").encode()
    plain = {name for name, kinds in table.columns.items() if not kinds & {bool, str}}
    for page in table.pages(rows):
        columns = [
            [row.get(name) for row in page]
            if name in plain
            else [_cell(row.get(name)) for row in page]
            for name in table.columns
        ]
        yield _lines(zip(*columns, strict=True)).encode()


def _cell(value: Any) -> Any:
    if value.__class__ is bool:
        return "true" if value else "false"
    if isinstance(value, str) and value.startswith(FORMULA):
        return f"'{value}"
    return value


def _lines(rows: Any) -> str:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


@dataclass(frozen=True, slots=True)
class _Numbers:
    """A table of numbers alone; see ``number_table``."""

    table: _Table
    fields: Sequence[parquet.Field]
    codes: Mapping[str, Mapping[str, int]]

    def column(self, page: Sequence[Mapping[str, Any]], field: parquet.Field) -> Iterable[Any]:
        """Return the numbers of one column of a page."""
        values = [row.get(field.name) for row in page]
        if field.name in TIMES:
            return number_table.cells([_seconds(value) for value in values], {})
        kept = [_value(value, field) for value in values]
        return number_table.cells(kept, self.codes.get(field.name, {}))


def _numbers(rows: Rows) -> Generator[bytes, None, _Numbers]:
    words = _Words()
    table = yield from _scan(rows, words)
    codes = words.codes()
    fields = [
        parquet.Field(name, "s", "seconds since 1970 in UTC", "float")
        if name in TIMES
        else _field(name, kinds)
        for name, kinds in table.columns.items()
    ]
    return _Numbers(
        table, [one for one in fields if one.kind != "text" or one.name in codes], codes
    )


def _seconds(time: str | None) -> float | None:
    return None if time is None else datetime.fromisoformat(time).timestamp()


def numbers_of(rows: Rows) -> Iterator[bytes]:
    """Yield parts of a CSV of numbers alone; see ``csv_of``."""
    yield FIXED[0].encode()
    numbers = yield from _numbers(rows)
    yield _lines([[one.name for one in numbers.fields]])[len(FIXED[0]) :].encode()
    for page in numbers.table.pages(rows):
        columns = [numbers.column(page, field) for field in numbers.fields]
        yield _lines(zip(*columns, strict=True)).encode()


def metadata_of(rows: Rows, name: str) -> Iterator[bytes]:
    """Yield parts of the CSVW metadata of that table, which has a name."""
    numbers = yield from _numbers(rows)
    kept = {one.name for one in numbers.fields}
    left_out = [one for one in numbers.table.columns if one not in kept]
    about = {"left out": ", ".join(left_out)} if left_out else {}
    yield number_table.metadata(name, numbers.fields, numbers.codes, about).encode()


def parquet_of(rows: Rows) -> Iterator[bytes]:
    """Parts of a Parquet file with the unit of each column in its metadata; see ``csv_of``."""
    yield MAGIC
    table = yield from _scan(rows)
    fields = [_field(name, kinds) for name, kinds in table.columns.items()]
    file = MemoryFile(len(MAGIC))
    with parquet.writing(cast("IO[bytes]", file), fields, {}, GROUP_ROWS) as writer:
        for page in table.pages(rows):
            writer.add({one.name: _column(page, one) for one in fields})
            yield file.take()
    yield file.take()


def _column(page: Sequence[Mapping[str, Any]], field: parquet.Field) -> list[Any]:
    column = [row.get(field.name) for row in page]
    if set(map(type, column)) <= EXACT[field.kind]:
        return column
    return [_value(value, field) for value in column]


def _field(name: str, kinds: frozenset[type[Any]]) -> parquet.Field:
    kind: parquet.Kind = "text"
    if kinds and kinds <= {bool}:
        kind = "bool"
    elif kinds and kinds <= {int, float}:
        kind = "float"
    return parquet.Field(name, unit_of(name.rpartition(".")[2]), "", kind)


def _value(value: Any, field: parquet.Field) -> Any:
    """A value of its column's type; None where a job that has changed meanwhile has another."""
    if value is None or field.kind == "text":
        return None if value is None else str(value)
    if isinstance(value, bool) is not (field.kind == "bool") or isinstance(value, str):
        return None
    return value if field.kind == "bool" else float(value)
