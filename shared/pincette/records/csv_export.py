"""Samples as CSV, for tools that read nothing else; a line at a time, whatever their number."""

import csv
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from typing import Any

from pincette.records import parquet

MEDIA_TYPE = "text/csv; charset=utf-8"
ROWS = 2048
"""Rows that are in memory at once."""


def csv_rows(path: Path) -> Iterator[str]:
    """Lines of a CSV from a Parquet file of samples.

    First comments: whose samples they are, then unit and meaning of each column. Then the names,
    then a line for each sample; what never came is empty, and numbers read back bit for bit.

    Raises
    ------
    OSError
        Where the file cannot be read; before the first line.
    """
    source = parquet.opened(path)
    schema = source.schema_arrow
    return _lines(source, schema)


def _lines(source: Any, schema: Any) -> Iterator[str]:
    try:
        for name, value in _texts(schema.metadata).items():
            yield _comment(f"{name}: {value}")
        for field in schema:
            told = _texts(field.metadata)
            unit = told.get("unit", "")
            meaning = told.get("meaning", "")
            yield _comment(f"{field.name}{f' [{unit}]' if unit else ''}: {meaning}")
        yield _line([field.name for field in schema])
        for batch in source.iter_batches(batch_size=ROWS):
            columns: list[list[Any]] = [column.to_pylist() for column in batch.columns]
            for row in zip(*columns, strict=True):
                yield _line([_cell(value) for value in row])
    finally:
        source.close()


def _texts(metadata: dict[bytes, bytes] | None) -> dict[str, str]:
    return {key.decode(): value.decode() for key, value in (metadata or {}).items()}


def _comment(text: str) -> str:
    return "# " + text.replace("\r", " ").replace("\n", " ") + "\n"


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return "true" if value else "false"
    return value


def _line(cells: list[Any]) -> str:
    stream = StringIO()
    csv.writer(stream, lineterminator="\n").writerow(cells)
    return stream.getvalue()
