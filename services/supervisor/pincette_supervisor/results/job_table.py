"""Many jobs as one table: a row for each, a column for whatever any of them has."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

from pincette.api.jobs import Job
from pincette.core.units import unit_of
from pincette.records import parquet

MEDIA_TYPES = {"csv": "text/csv; charset=utf-8", "parquet": "application/vnd.apache.parquet"}
FIRST = ("id", "rig", "kind", "state", "created_at", "started_at", "ended_at", "by")
SAID = ("sample", "batch", "operator", "notes")
GROUPS = ("", "label", "value", "result")
"""Begins of the names of columns, in their order."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Begins of texts that a spreadsheet would work out."""
Rows = Mapping[str, Sequence[Any]]


def table_of(jobs: Sequence[Job]) -> Rows:
    """Columns by name, of one length; a value that a job does not have is None."""
    rows = [_row(job) for job in jobs]
    names = list(dict.fromkeys(name for row in rows for name in row)) or [*FIRST, "ending", *SAID]
    names.sort(key=lambda name: GROUPS.index(_group(name)))
    return {name: [row.get(name) for row in rows] for name in names}


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


def csv_of(table: Rows) -> Iterator[str]:
    """Lines of a CSV; a number reads back bit for bit, and no text is a formula."""
    yield _line(list(table))
    for row in zip(*table.values(), strict=True):
        yield _line(row)


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


def parquet_of(table: Rows) -> bytes:
    """A Parquet file with the unit of each column in its metadata."""
    fields: list[parquet.Field] = []
    columns: dict[str, list[Any]] = {}
    for name, values in table.items():
        kinds: set[type[Any]] = {type(value) for value in values if value is not None}
        unit = unit_of(name.rpartition(".")[2])
        if kinds and kinds <= {bool}:
            fields.append(parquet.Field(name, unit, "", "bool"))
            columns[name] = list(values)
        elif kinds and kinds <= {int, float}:
            fields.append(parquet.Field(name, unit, "", "float"))
            columns[name] = [None if value is None else float(value) for value in values]
        else:
            fields.append(parquet.Field(name, unit, "", "text"))
            columns[name] = [None if value is None else str(value) for value in values]
    target = io.BytesIO()
    parquet.write(target, fields, columns, {})
    return target.getvalue()
