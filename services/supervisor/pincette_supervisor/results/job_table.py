"""Many jobs as one table: a row for each, a column for whatever any of them has."""

import re
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import IO, Any, NamedTuple, cast

import msgspec

from pincette.api.jobs import Job
from pincette.core.units import unit_of
from pincette.records import number_table, parquet
from pincette.records.memory_file import MemoryFile
from pincette_supervisor.journal.tables import TableRow

FIRST = ("id", "rig", "kind", "state", "created_at", "started_at", "ended_at", "by")
SAID = ("sample", "batch", "operator", "notes")
FIXED = (*FIRST, "ending", *SAID)
"""Columns of every table; they come first."""
BEGINS = ("label", "value", "result")
"""Begins of the names of all other columns, in their order: one for each map of a row."""
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
NUMBERS = frozenset({int, float, bool, type(None)})
"""Types whose JSON is their text in a CSV, but for None."""
SCALARS = (str, int, float, type(None))
"""Types of values that a table has."""
TIMES = tuple(name for name in FIXED if name.endswith("_at"))
MOST_WORDS = 1_000
"""Different words of a column of numbers at most; a column with more, but ``id``, is left out."""
MOST_SHAPES = 10_000
"""Shapes of maps that are remembered at once."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Begins of texts that a spreadsheet would work out."""
QUOTED = re.compile(r'[",\r\n]')
"""What a text is quoted for in a CSV."""
Rows = Callable[[], Iterator[Sequence[TableRow]]]
"""Begins to read the jobs, a page at a time."""
Column = Sequence[Any]


def row_of(job: Job) -> TableRow:
    """Return what a table takes from a job."""
    ending = None if job.ending is None else job.ending.code
    fixed = [getattr(job, name) for name in FIRST], ending, [getattr(job, name) for name in SAID]
    return TableRow((*fixed[0], fixed[1], *fixed[2]), (job.labels, job.values, job.result))


class _Shape(NamedTuple):
    """Maps with the same keys and types of values."""

    places: tuple[int, ...]
    """Number of the column of each value; -1 for a list, a map, and a name without a column."""
    inner: tuple[tuple[str, str], ...]
    """Key of each map, and the name of the columns that its own begin with."""
    words: tuple[tuple[str, str], ...]
    """Key of each text, and the name of its column."""


class _Columns:
    """Finds the columns of a table, and moves the values of rows to them.

    Jobs of one kind have the same keys. So the names of columns are put together once for each
    shape of a map, and not for each row.
    """

    def __init__(self) -> None:
        self.kinds: dict[str, set[type[Any]]] = {name: {str} for name in FIXED}
        """Types of the values of each column, in the order in which the columns were found."""
        self._numbers = {name: number for number, name in enumerate(FIXED)}
        self._shapes: dict[Any, _Shape] = {}
        self._complete = False

    def find(self, row: TableRow, words: "_Words | None") -> None:
        """Add the columns that a row needs, and its words."""
        for begin, tree in zip(BEGINS, row.trees, strict=True):
            if tree:
                self._find(begin, tree, words)

    def _find(self, begin: str, tree: Mapping[str, Any], words: "_Words | None") -> None:
        shape = self._shape(begin, tree)
        if words is not None:
            for key, name in shape.words:
                words.add(name, tree[key])
        for key, name in shape.inner:
            self._find(name, tree[key], words)

    def complete(self) -> dict[str, int]:
        """Add no more columns; returns the number of each by name, in the order of the table."""
        self._complete = True
        self._shapes.clear()
        more = [name for name in self._numbers if name not in FIXED]
        more.sort(key=lambda name: BEGINS.index(name.partition(".")[0]))
        return {name: self._numbers[name] for name in (*FIXED, *more)}

    def values(self, row: TableRow) -> list[Any]:
        """Return the values of a row by the numbers of their columns; what it lacks is None."""
        values = [*row.fixed, *[None] * (len(self._numbers) - len(FIXED) + 1)]
        for begin, tree in zip(BEGINS, row.trees, strict=True):
            if tree:
                self._fill(values, begin, tree)
        return values

    def _fill(self, values: list[Any], begin: str, tree: Mapping[str, Any]) -> None:
        shape = self._shape(begin, tree)
        for place, value in zip(shape.places, tree.values(), strict=True):
            values[place] = value
        for key, name in shape.inner:
            self._fill(values, name, tree[key])

    def _shape(self, begin: str, tree: Mapping[str, Any]) -> _Shape:
        key = begin, tuple(tree), tuple(map(type, tree.values()))
        found = self._shapes.get(key)
        if found is None:
            if len(self._shapes) >= MOST_SHAPES:
                self._shapes.clear()
            found = self._shapes[key] = self._new_shape(begin, tree)
        return found

    def _new_shape(self, begin: str, tree: Mapping[str, Any]) -> _Shape:
        names = {key: f"{begin}.{key}" for key in tree}
        inner = tuple((key, names[key]) for key, value in tree.items() if isinstance(value, dict))
        words = tuple((key, names[key]) for key, value in tree.items() if isinstance(value, str))
        places = [
            self._place(names[key], type(value)) if isinstance(value, SCALARS) else -1
            for key, value in tree.items()
        ]
        return _Shape(tuple(places), inner, words)

    def _place(self, name: str, kind: type[Any]) -> int:
        if self._complete:
            return self._numbers.get(name, -1)
        self.kinds.setdefault(name, set()).add(kind)
        return self._numbers.setdefault(name, len(self._numbers))


@dataclass(frozen=True, slots=True)
class _Table:
    """The columns that were found, and what puts the values of a row into them."""

    fields: Mapping[str, parquet.Field]
    """Columns by name, in their order."""
    numbers: Sequence[int]
    columns: _Columns

    def pages(self, rows: Rows) -> Iterator[dict[str, Column]]:
        """Read the rows, a page of columns at a time."""
        for page in rows():
            if page:
                found = list(zip(*map(self.columns.values, page), strict=True))
                yield {
                    name: found[number]
                    for name, number in zip(self.fields, self.numbers, strict=True)
                }


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
    columns = _Columns()
    for page in rows():
        for row in page:
            columns.find(row, words)
            if words is not None:
                for name, word in zip(FIXED, row.fixed, strict=True):
                    if word is not None and name not in TIMES:
                        words.add(name, word)
        yield b""
    numbers = columns.complete()
    fields = {name: _field(name, columns.kinds[name] - {type(None)}) for name in numbers}
    return _Table(fields, [*numbers.values()], columns)


def csv_of(rows: Rows) -> Iterator[bytes]:
    """Yield parts of a CSV; a number reads back bit for bit, and no text is a formula.

    The jobs are read twice: for the columns and for the rows. The names of the fixed columns come
    at once. No more than a page of jobs is in memory.
    """
    yield ",".join(FIXED).encode()
    table = yield from _scan(rows)
    more = [*table.fields][len(FIXED) :]
    yield (f",{_lines([_cells(more)])}" if more else "\n").encode()
    for page in table.pages(rows):
        yield _lines(zip(*map(_cells, page.values()), strict=True)).encode()


def _cells(column: Column) -> Iterable[str]:
    if set(map(type, column)) <= NUMBERS:
        return _number_cells(column, "")
    return map(_cell, column)


def _number_cells(column: Column, none: str) -> list[str]:
    """Return the texts of numbers, which JSON writes ten times as fast as Python does."""
    text = msgspec.json.encode(column)[1:-1].decode()
    return text.replace("null", none).split(",")


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if value.__class__ is bool:
        return "true" if value else "false"
    text = str(value)
    if value.__class__ is str and text.startswith(FORMULA):
        text = f"'{text}"
    return '"' + text.replace('"', '""') + '"' if QUOTED.search(text) else text


def _lines(rows: Iterable[Iterable[str]]) -> str:
    """Return lines as RFC 4180 has them; ``csv.writer`` looks at each character of each number."""
    return "".join(f"{line}\n" for line in map(",".join, rows))


@dataclass(frozen=True, slots=True)
class _Numbers:
    """A table of numbers alone; see ``number_table``."""

    table: _Table
    fields: Sequence[parquet.Field]
    codes: Mapping[str, Mapping[str, int]]

    def cells(self, column: Column, field: parquet.Field) -> Iterable[str]:
        """Return the texts of one column of a page."""
        if field.name in TIMES:
            found = [_seconds(value) for value in column]
        elif field.kind == "bool":
            found = [None if value is None else int(value) for value in _exact(column, field)]
        elif field.kind == "text":
            codes = self.codes[field.name]
            found = [codes.get(value) for value in _exact(column, field)]
        else:
            found = _exact(column, field)
        return _number_cells(found, number_table.NONE)


def _numbers(rows: Rows) -> Generator[bytes, None, _Numbers]:
    words = _Words()
    table = yield from _scan(rows, words)
    codes = words.codes()
    times = {name: parquet.Field(name, "s", "seconds since 1970 in UTC", "float") for name in TIMES}
    fields = [times.get(name, field) for name, field in table.fields.items()]
    kept = [one for one in fields if one.kind != "text" or one.name in codes]
    return _Numbers(table, kept, codes)


def _seconds(time: str | None) -> float | None:
    return None if time is None else datetime.fromisoformat(time).timestamp()


def numbers_of(rows: Rows) -> Iterator[bytes]:
    """Yield parts of a CSV of numbers alone; see ``csv_of``."""
    yield FIXED[0].encode()
    numbers = yield from _numbers(rows)
    names = _cells([one.name for one in numbers.fields])
    yield _lines([names])[len(FIXED[0]) :].encode()
    for page in numbers.table.pages(rows):
        columns = [numbers.cells(page[field.name], field) for field in numbers.fields]
        yield _lines(zip(*columns, strict=True)).encode()


def metadata_of(rows: Rows, name: str) -> Iterator[bytes]:
    """Yield parts of the CSVW metadata of that table, which has a name."""
    numbers = yield from _numbers(rows)
    kept = {one.name for one in numbers.fields}
    left_out = [one for one in numbers.table.fields if one not in kept]
    about = {"left out": ", ".join(left_out)} if left_out else {}
    yield number_table.metadata(name, numbers.fields, numbers.codes, about).encode()


def parquet_of(rows: Rows) -> Iterator[bytes]:
    """Parts of a Parquet file with the unit of each column in its metadata; see ``csv_of``."""
    yield MAGIC
    table = yield from _scan(rows)
    fields = table.fields
    file = MemoryFile(len(MAGIC))
    with parquet.writing(cast("IO[bytes]", file), [*fields.values()], {}, GROUP_ROWS) as writer:
        for page in table.pages(rows):
            writer.add({name: _exact(column, fields[name]) for name, column in page.items()})
            yield file.take()
    yield file.take()


def _exact(column: Column, field: parquet.Field) -> Column:
    """Return a column with values of its type alone."""
    if set(map(type, column)) <= EXACT[field.kind]:
        return column
    return [_value(value, field) for value in column]


def _field(name: str, kinds: set[type[Any]]) -> parquet.Field:
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
