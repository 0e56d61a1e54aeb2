"""Many jobs as one table: a row for each, a column for whatever any of them has."""

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any, cast

from pincette.api.jobs import Job
from pincette.core.units import unit_of
from pincette.records import parquet

MEDIA_TYPES = {"csv": "text/csv; charset=utf-8", "parquet": "application/vnd.apache.parquet"}
FIRST = ("id", "rig", "kind", "state", "created_at", "started_at", "ended_at", "by")
SAID = ("sample", "batch", "operator", "notes")
GROUP_ROWS = 2_000
"""Rows of a row group of a Parquet file."""
GROUPS = ("", "label", "value", "result")
"""Begins of the names of columns, in their order."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Begins of texts that a spreadsheet would work out."""
Pages = Callable[[], Iterator[Sequence[Job]]]
"""Begins to read the jobs again, a page at a time."""


@dataclass(frozen=True, slots=True)
class JobTable:
    """Jobs as rows of named columns; no more than a page of them is in memory at once."""

    pages: Pages
    columns: Mapping[str, frozenset[type[Any]]]
    """Types of the values of each column, by its name."""

    def rows(self) -> Iterator[Sequence[Mapping[str, Any]]]:
        """Pages of rows; a row lacks the columns for which its job has no value."""
        for page in self.pages():
            yield [_row(job) for job in page]


def table_of(pages: Pages) -> JobTable:
    """Read the jobs once to find the columns; they are read again for the rows."""
    found: dict[str, set[type[Any]]] = {}
    for page in pages():
        for job in page:
            for name, value in _row(job).items():
                kinds = found.setdefault(name, set())
                if value is not None:
                    kinds.add(cast("type[Any]", type(value)))
    if not found:
        found = {name: set() for name in (*FIRST, "ending", *SAID)}
    names = sorted(found, key=lambda name: GROUPS.index(_group(name)))
    return JobTable(pages, {name: frozenset(found[name]) for name in names})


def _group(name: str) -> str:
    begin = name.partition(".")[0]
    return begin if begin in GROUPS else ""


def _row(job: Job) -> dict[str, Any]:
    row: dict[str, Any] = {name: getattr(job, name) for name in FIRST}
    row["ending"] = None if job.ending is None else job.ending.code
    row |= {name: getattr(job, name) for name in SAID}
    row |= {f"label.{name}": text for name, text in job.labels.items()}
    row |= _flat("value", job.values)
    return row | _flat("result", job.result or {})


def _flat(name: str, tree: Mapping[str, Any]) -> dict[str, Any]:
    """Every value that is neither list nor map, under the names of all that it is in."""
    found: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            found |= _flat(f"{name}.{key}", cast("Mapping[str, Any]", value))
        elif not isinstance(value, list):
            found[f"{name}.{key}"] = value
    return found


def csv_of(table: JobTable) -> Iterator[str]:
    """Lines of a CSV; a number reads back bit for bit, and no text is a formula."""
    yield _line(list(table.columns))
    for page in table.rows():
        for row in page:
            yield _line([row.get(name) for name in table.columns])


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str) and value.startswith(FORMULA):
        return f"'{value}"
    return value


def _line(cells: Sequence[Any]) -> str:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerow([_cell(cell) for cell in cells])
    return stream.getvalue()


class _Parts:
    """File in memory for what was written since the last ``take``; no disk is needed."""

    closed = False

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def write(self, part: bytes) -> int:
        """Append a part."""
        self._parts.append(bytes(part))
        return len(part)

    def flush(self) -> None:
        """Do nothing: no part waits elsewhere."""

    def take(self) -> bytes:
        """Return what was written since the last call."""
        found = b"".join(self._parts)
        self._parts.clear()
        return found


def parquet_of(table: JobTable) -> Iterator[bytes]:
    """Parts of a Parquet file with the unit of each column in its metadata."""
    fields = [_field(name, kinds) for name, kinds in table.columns.items()]
    file = _Parts()
    with parquet.writing(cast("IO[bytes]", file), fields, {}, GROUP_ROWS) as writer:
        for page in table.rows():
            writer.add(
                {one.name: [_value(row.get(one.name), one) for row in page] for one in fields}
            )
            if part := file.take():
                yield part
    yield file.take()


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
