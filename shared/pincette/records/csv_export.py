"""Samples as CSV, written line by line for any number of samples."""

import csv
from collections.abc import Iterable, Iterator, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

from pincette.core.faults import Acted, Cause, Mode, Outcome, Phase
from pincette.records import number_table, parquet

MEDIA_TYPE = "text/csv; charset=utf-8"
ROWS = 2048
"""Largest number of rows in memory at once."""
NUMBERS = "numbers.csv"
"""File name of the samples as numbers only."""
WORDS: Mapping[str, Iterable[str]] = {
    "actuator_state": Mode,
    "actuator_cause": Cause,
    "phase": Phase,
    "outcome": Outcome,
    "acted": ("", *Acted),
}
"""Words of the columns whose codes are the same in every file, numbered from 0."""


def csv_rows(path: Path) -> Iterator[str]:
    """Return the CSV lines of a Parquet file of samples; raises OSError before the first line."""
    return _lines(parquet.opened(path))


def _lines(source: Any) -> Iterator[str]:
    """Yield comments on the samples, unit and meaning of each column, names, then samples."""
    # A missing value is empty, and numbers read back bit for bit.
    schema = source.schema_arrow
    for name, value in parquet.about_of(schema).items():
        yield _comment(f"{name}: {value}")
    for field in parquet.fields_of(schema):
        unit = f" [{field.unit}]" if field.unit else ""
        yield _comment(f"{field.name}{unit}: {field.meaning}")
    yield from _table(source, None)


def number_rows(path: Path) -> Iterator[str]:
    """Yield the lines of the same CSV with numbers only, by ``number_table``.

    Raises as ``csv_rows``.
    """
    source = parquet.opened(path)
    return _table(source, _codes(path, parquet.fields_of(source.schema_arrow)))


def number_metadata(path: Path) -> Iterator[str]:
    """Return the CSVW metadata of ``number_rows``; raises OSError before the first part."""
    source = parquet.opened(path)
    try:
        fields = parquet.fields_of(source.schema_arrow)
        about = parquet.about_of(source.schema_arrow)
        text = number_table.metadata(NUMBERS, fields, _codes(path, fields), about)
    finally:
        source.close()
    return iter([text])


def _codes(path: Path, fields: Iterable[parquet.Field]) -> number_table.Codes:
    """Number the words of each column of texts: those of ``WORDS``, others as they appear."""
    texts = [one.name for one in fields if one.kind == "text"]
    codes = {
        name: {str(word): code for code, word in enumerate(WORDS.get(name, ()))} for name in texts
    }
    for part in parquet.parts(path, texts):
        for name, values in part.items():
            known = codes[name]
            for word in dict.fromkeys(values):
                if word is not None:
                    known.setdefault(word, len(known))
    return codes


def _table(source: Any, codes: number_table.Codes | None) -> Iterator[str]:
    """Yield the names, then the samples; if ``codes`` are given, everything as numbers."""
    names = source.schema_arrow.names
    try:
        yield _line(names)
        for batch in source.iter_batches(batch_size=ROWS):
            columns: list[list[Any]] = [column.to_pylist() for column in batch.columns]
            if codes is not None:
                columns = [
                    number_table.cells(column, codes.get(name, {}))
                    for name, column in zip(names, columns, strict=True)
                ]
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
