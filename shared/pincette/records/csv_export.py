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
    """Lines of a CSV from a Parquet file of samples; raises OSError before the first line."""
    return _lines(parquet.opened(path))


def _lines(source: Any) -> Iterator[str]:
    """Comments on the samples, unit and meaning of each column, the names, then the samples."""
    # A value that never came is empty, and numbers read back bit for bit.
    schema = source.schema_arrow
    try:
        for name, value in parquet.about_of(schema).items():
            yield _comment(f"{name}: {value}")
        for field in schema:
            metadata = parquet.texts(field.metadata)
            unit = f" [{metadata['unit']}]" if metadata.get("unit") else ""
            yield _comment(f"{field.name}{unit}: {metadata.get('meaning', '')}")
        yield _line([field.name for field in schema])
        for batch in source.iter_batches(batch_size=ROWS):
            columns: list[list[Any]] = [column.to_pylist() for column in batch.columns]
            for row in zip(*columns, strict=True):
                yield _line([_cell(value) for value in row])
    finally:
        source.close()


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
