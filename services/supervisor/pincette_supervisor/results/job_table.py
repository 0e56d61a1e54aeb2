"""Many jobs as one table: a row for each job, and a column for each value that any job has."""

import operator
import re
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from types import NoneType
from typing import IO, Any, cast

import msgspec

from pincette.api.jobs import DESCRIPTION, Job
from pincette.core.units import unit_of
from pincette.records import number_table, parquet
from pincette.records.memory_file import MemoryFile
from pincette_supervisor.journal.tables import TableRow

FIRST = ("id", "rig", "kind", "state", "created_at", "started_at", "ended_at", "by")
FIXED = (*FIRST, "ending", *DESCRIPTION)
"""Columns of every table; they come first."""
LABEL, VALUE, RESULT = BEGINS = ("label", "value", "result")
"""Prefixes of the names of all other columns, in their order, one for each map of a job."""
GROUP_ROWS = 2_000
"""Number of rows of a row group of a Parquet file."""
EXACT: Mapping[parquet.Kind, frozenset[Any]] = {
    "text": frozenset({str, NoneType}),
    "bool": frozenset({bool, NoneType}),
    "float": frozenset({float, NoneType}),
}
"""Types that a column of a Parquet file stores unchanged."""
NUMBERS = frozenset({int, float})
MAPS = frozenset({dict, list})
"""Types of values that have no column of their own."""
TIMES = tuple(name for name in FIXED if name.endswith("_at"))
MOST_WORDS = 1_000
"""Largest number of different words in a column of numbers; a column with more, except ``id``, is
left out."""
MOST_TYPES = 200
"""Largest number of types that are created for the jobs of one kind; further jobs are decoded
more slowly."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters of texts that a spreadsheet would evaluate."""
QUOTED = re.compile(r'[",\r\n]')
"""Characters that make it necessary to quote a text in a CSV."""
Rows = Callable[[], Iterator[Sequence[TableRow]]]
"""Function that starts reading the jobs, a page at a time."""
Tree = Mapping[str, Any]
_TREE = msgspec.json.Decoder(dict[str, Any] | None)


class _List(msgspec.Struct, array_like=True, gc=False):
    """A list within a job, which has no column; the decoder skips its items."""


def row_of(job: Job) -> TableRow:
    """Return the row of a job in a table."""
    ending = None if job.ending is None else job.ending.code
    said = [getattr(job, name) for name in DESCRIPTION]
    return TableRow(
        (*(getattr(job, name) for name in FIRST), ending, *said),
        _json(job.labels),
        _json(job.values),
        _json(job.result),
    )


def _json(tree: Any) -> str:
    return msgspec.json.encode(tree).decode()


def _trees(row: TableRow) -> tuple[Tree, ...]:
    """Return labels, values and result of a job as maps with any keys."""
    return tuple((_TREE.decode(text) or {}) for text in (row.labels, row.values, row.result))


class _Map:
    """Maps at one place in the jobs of one kind: their keys, and the columns of their values."""

    def __init__(self, name: str) -> None:
        self._name = name
        """Prefix of the names of the columns."""
        self._types: dict[str, set[Any]] = {}
        """Types of the values of each key."""
        self._inner: dict[str, _Map] = {}
        self._places: list[int] = []
        """Column number of each key; -1 for a list or a map, which has none."""
        self._maps: list[tuple[int, _Map]] = []
        """Positions of the keys whose values are maps."""

    def add(self, tree: Tree) -> None:
        """Note the keys of a map, and the types of their values."""
        for key, value in tree.items():
            self._types.setdefault(key, set()).add(type(value))
            if isinstance(value, dict):
                if key not in self._inner:
                    self._inner[key] = _Map(f"{self._name}.{key}")
                self._inner[key].add(cast(Tree, value))

    def decoded(self) -> Any:
        """Return the type to which such a map is decoded; raises ValueError if there is none."""
        names = {f"m{number}": key for number, key in enumerate(self._types)}
        return msgspec.defstruct(
            "Map",
            [(name, self._member(key), None) for name, key in names.items()],
            rename=names,
            forbid_unknown_fields=True,
            gc=False,
        )

    def _member(self, key: str) -> Any:
        types = self._types[key] - {NoneType}
        if types & NUMBERS:
            types |= NUMBERS
        if types == {dict}:
            types = {self._inner[key].decoded()}
        elif types == {list}:
            types = {_List}
        elif types & MAPS:
            raise ValueError(f"{self._name}.{key} is a map in some jobs and another type in others")
        member: Any = None
        for one in types:
            member |= one
        return member

    def columns(self) -> Iterator[tuple[str, set[Any]]]:
        """Yield the name and types of each column."""
        for key, types in self._types.items():
            if types - MAPS - {NoneType} or not types & MAPS:
                yield f"{self._name}.{key}", types - MAPS
        for inner in self._inner.values():
            yield from inner.columns()

    def place(self, numbers: Mapping[str, int]) -> None:
        """Store the column number of each key; call this once all columns are known."""
        self._places = [
            -1 if types & MAPS else numbers[f"{self._name}.{key}"]
            for key, types in self._types.items()
        ]
        places = {key: number for number, key in enumerate(self._types)}
        self._maps = [(places[key], inner) for key, inner in self._inner.items()]
        for inner in self._inner.values():
            inner.place(numbers)

    def fill(self, values: list[Any], found: msgspec.Struct) -> None:
        """Copy the values of a map to their columns."""
        members = msgspec.structs.astuple(found)
        for place, value in zip(self._places, members, strict=True):
            values[place] = value
        for place, inner in self._maps:
            if members[place] is not None:
                inner.fill(values, members[place])


class _Reader:
    """Decoder of the jobs of one kind, which have the same keys.

    A type with these keys is decoded three times as fast as maps are. A job with another key, or
    with another type of a value, leads to a new type.
    """

    def __init__(self) -> None:
        self.maps = _Map(VALUE), _Map(RESULT)
        self._decoders: tuple[msgspec.json.Decoder[Any], ...] = ()
        self._left = MOST_TYPES

    def add(self, trees: Iterable[Tree]) -> None:
        """Note the keys of a job that ``decode`` does not know."""
        for one, tree in zip(self.maps, trees, strict=True):
            one.add(tree)
        self._decoders = ()
        if self._left:
            self._left -= 1
            try:
                types = [one.decoded() | None for one in self.maps]
            except ValueError:  # such as a key that msgspec does not accept as a name
                self._left = 0
                return
            self._decoders = tuple(map(msgspec.json.Decoder, types))

    def decode(self, row: TableRow) -> tuple[Any, Any] | None:
        """Return values and result of a job; None if it has other keys or types."""
        if not self._decoders:
            return None
        values, result = self._decoders
        try:
            return values.decode(row.values), result.decode(row.result)
        except msgspec.ValidationError:
            return None


class _Columns:
    """Columns of a table, into which the values of rows are copied."""

    def __init__(self) -> None:
        self.types: dict[str, set[Any]] = {name: {str} for name in FIXED}
        """Types of the values of each column, in the order of the table."""
        self._numbers: dict[str, int] = {}
        self._labels = _Map(LABEL)
        self._readers: dict[str | None, _Reader] = {}

    def find(self, row: TableRow, words: "_Words | None") -> None:
        """Add the columns and the words of a row."""
        reader = self._reader(row)
        if words is None and reader.decode(row) is not None:
            self._labels.add(_TREE.decode(row.labels) or {})
            return
        trees = _trees(row)
        self._labels.add(trees[0])
        reader.add(trees[1:])
        if words is not None:
            words.add_row(row, trees)

    def _reader(self, row: TableRow) -> _Reader:
        kind = row.fixed[2]
        if kind not in self._readers:
            self._readers[kind] = _Reader()
        return self._readers[kind]

    def complete(self) -> None:
        """Declare the columns complete."""
        readers = self._readers.values()
        maps = [self._labels, *(one.maps[0] for one in readers), *(one.maps[1] for one in readers)]
        for one in maps:
            for name, types in one.columns():
                self.types.setdefault(name, set()).update(types)
        self._numbers = {name: number for number, name in enumerate(self.types)}
        for one in maps:
            one.place(self._numbers)

    def values(self, row: TableRow) -> list[Any]:
        """Return the values of a row by column number; missing ones are None."""
        values = [*row.fixed, *[None] * (len(self._numbers) - len(FIXED) + 1)]
        reader = self._reader(row)
        found = reader.decode(row)
        if found is None:  # the job has changed in between
            for begin, tree in zip(BEGINS, _trees(row), strict=True):
                self._fill(values, begin, tree)
        else:
            self._fill(values, LABEL, _TREE.decode(row.labels) or {})
            for one, tree in zip(reader.maps, found, strict=True):
                if tree is not None:
                    one.fill(values, tree)
        del values[-1]
        return values

    def _fill(self, values: list[Any], begin: str, tree: Tree) -> None:
        """Copy the values of a map to their columns; values of another type are left out."""
        for key, value in tree.items():
            name = f"{begin}.{key}"
            if isinstance(value, dict):
                self._fill(values, name, cast(Tree, value))
            elif type(value) in self.types.get(name, ()):
                values[self._numbers[name]] = value


@dataclass(frozen=True, slots=True)
class _Table:
    """Columns of a table, with the functions that fill them from rows."""

    fields: Mapping[str, parquet.Field]
    """Columns by name, in their order."""
    columns: _Columns

    def pages(self, rows: Rows) -> Iterator[list[list[Any]]]:
        """Read the values of the rows, a page at a time."""
        for page in rows():
            if page:
                yield [self.columns.values(row) for row in page]


class _Words:
    """The words of each column, numbered from the oldest job on."""

    def __init__(self) -> None:
        self._newest_first: dict[str, dict[str, None]] = {}

    def add_row(self, row: TableRow, trees: Iterable[Tree]) -> None:
        """Add the words of the next older job."""
        for name, word in zip(FIXED, row.fixed, strict=True):
            if word is not None and name not in TIMES:
                self._add(name, word)
        for begin, tree in zip(BEGINS, trees, strict=True):
            self._add_tree(begin, tree)

    def _add_tree(self, begin: str, tree: Tree) -> None:
        for key, value in tree.items():
            if isinstance(value, str):
                self._add(f"{begin}.{key}", value)
            elif isinstance(value, dict):
                self._add_tree(f"{begin}.{key}", cast(Tree, value))

    def _add(self, name: str, word: str) -> None:
        found = self._newest_first.setdefault(name, {})
        if len(found) <= MOST_WORDS or name == FIXED[0]:
            found.pop(word, None)
            found[word] = None

    def codes(self) -> dict[str, dict[str, int]]:
        """Return the number of each word by column, without columns of too many words."""
        return {
            name: {word: code for code, word in enumerate(reversed(found), start=1)}
            for name, found in self._newest_first.items()
            if len(found) <= MOST_WORDS or name == FIXED[0]
        }


def _scan(rows: Rows, words: _Words | None = None) -> Generator[bytes, None, _Table]:
    """Find the columns; yields an empty part after each page, so that a client can disconnect."""
    columns = _Columns()
    for page in rows():
        for row in page:
            columns.find(row, words)
        yield b""
    columns.complete()
    return _Table({name: _field(name, found) for name, found in columns.types.items()}, columns)


def csv_of(rows: Rows) -> Iterator[bytes]:
    """Yield parts of a CSV; numbers are read back bit for bit, and no text acts as a formula.

    The jobs are read twice: for the columns and for the rows. The names of the fixed columns come
    at once. At most one page of jobs is in memory.
    """
    yield ",".join(FIXED).encode()
    table = yield from _scan(rows)
    yield b"".join(b"," + _cell(name) for name in [*table.fields][len(FIXED) :]) + b"\n"
    for page in table.pages(rows):
        yield b"".join(_line(map(_csv_value, values)) for values in page)


def _csv_value(value: Any) -> Any:
    if value is None:
        return NOTHING
    return _cell(value) if value.__class__ is str else value


NOTHING = msgspec.Raw(b"")


@lru_cache(512)
def _cell(text: str) -> msgspec.Raw:
    """Return a text as a field of RFC 4180."""
    if text.startswith(FORMULA):
        text = f"'{text}"
    if QUOTED.search(text):
        text = '"' + text.replace('"', '""') + '"'
    return msgspec.Raw(text.encode())


def _line(values: Iterable[Any]) -> bytes:
    """Return a line of a CSV. Numbers have the form of JSON, which msgspec writes faster than
    Python.
    """
    return msgspec.json.encode([*values])[1:-1] + b"\n"


@dataclass(frozen=True, slots=True)
class _Numbers:
    """A table of numbers only; see ``number_table``."""

    table: _Table
    fields: Sequence[parquet.Field]
    codes: Mapping[str, Mapping[str, int]]

    def pages(self, rows: Rows) -> Iterator[bytes]:
        """Read the rows, as lines."""
        chosen = operator.itemgetter(*map([*self.table.fields].index, self.names))
        readers = [self._reader(one) for one in self.fields]
        for page in self.table.pages(rows):
            lines = b"".join(
                _line(
                    value if read is None or value is None else read(value)
                    for read, value in zip(readers, chosen(values), strict=True)
                )
                for values in page
            )
            for word, number in WORDS_OF_JSON:
                lines = lines.replace(word, number)
            yield lines

    @property
    def names(self) -> list[str]:
        """Return the names of the columns."""
        return [one.name for one in self.fields]

    def _reader(self, field: parquet.Field) -> Callable[[Any], Any] | None:
        """Return the function that converts a value to a number; None if the value is a number."""
        if field.name in TIMES:
            return _seconds
        return self.codes[field.name].get if field.kind == "text" else None


WORDS_OF_JSON = (b"null", number_table.NONE.encode()), (b"true", b"1"), (b"false", b"0")
"""JSON words for values that are no numbers, and their replacements."""


def _numbers(rows: Rows) -> Generator[bytes, None, _Numbers]:
    words = _Words()
    table = yield from _scan(rows, words)
    codes = words.codes()
    times = {name: parquet.Field(name, "s", "seconds since 1970 in UTC", "float") for name in TIMES}
    fields = [times.get(name, field) for name, field in table.fields.items()]
    kept = [one for one in fields if one.kind != "text" or one.name in codes]
    return _Numbers(table, kept, codes)


def _seconds(time: str) -> float:
    return datetime.fromisoformat(time).timestamp()


def numbers_of(rows: Rows) -> Iterator[bytes]:
    """Yield parts of a CSV with numbers only; see ``csv_of``."""
    yield FIXED[0].encode()
    numbers = yield from _numbers(rows)
    yield b"".join(b"," + _cell(name) for name in numbers.names[1:]) + b"\n"
    yield from numbers.pages(rows)


def metadata_of(rows: Rows, name: str) -> Iterator[bytes]:
    """Yield parts of the CSVW metadata of the table of ``numbers_of``; ``name`` is the name of its
    file.
    """
    numbers = yield from _numbers(rows)
    left_out = [one for one in numbers.table.fields if one not in set(numbers.names)]
    about = {"left out": ", ".join(left_out)} if left_out else {}
    yield number_table.metadata(name, numbers.fields, numbers.codes, about).encode()


def parquet_of(rows: Rows) -> Iterator[bytes]:
    """Yield parts of a Parquet file with column units in its metadata; see ``csv_of``."""
    yield parquet.MAGIC
    table = yield from _scan(rows)
    fields = [*table.fields.values()]
    exact = [table.columns.types[one.name] <= EXACT[one.kind] for one in fields]
    file = MemoryFile(len(parquet.MAGIC))
    with parquet.writing(cast("IO[bytes]", file), fields, {}, GROUP_ROWS) as writer:
        for page in table.pages(rows):
            columns = zip(fields, exact, zip(*page, strict=True), strict=True)
            writer.add(
                {
                    field.name: column if kept else [_value(value, field) for value in column]
                    for field, kept, column in columns
                }
            )
            yield file.take()
    yield file.take()


def _field(name: str, types: set[Any]) -> parquet.Field:
    kind: parquet.Kind = "text"
    known = types - {NoneType}
    if known == {bool}:
        kind = "bool"
    elif known and known <= NUMBERS:
        kind = "float"
    return parquet.Field(name, unit_of(name.rpartition(".")[2]), "", kind)


def _value(value: Any, field: parquet.Field) -> Any:
    """Return a value converted to the type of its column."""
    if value is None:
        return None
    return str(value) if field.kind == "text" else float(value)
