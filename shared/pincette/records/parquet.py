"""Columns as Parquet, each with its unit and meaning; the only module that imports pyarrow."""

import base64
import json
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

Kind = Literal["float", "int", "bool", "text"]


@dataclass(frozen=True, slots=True)
class Field:
    """Properties of a column."""

    name: str
    unit: str
    meaning: str
    kind: Kind


MAGIC = b"PAR1"
"""First bytes of every Parquet file."""
COLUMNS = "columns"
"""Metadata key for readers that ignore Arrow's metadata: unit and meaning of each column, as JSON.
"""
KINDS: Mapping[str, Kind] = {"double": "float", "int64": "int", "bool": "bool", "string": "text"}
"""Kind of a column, by the name of its Arrow type."""
PART_ROWS = 8192
"""Number of rows that are read at once when a table is read in parts."""
GROUP_ROWS = 65_536
"""Smallest number of rows in a row group. As many rows are in memory; a file has few groups."""


class Writer:
    """Writes a table part by part."""

    def __init__(self, source: Any, schema: Any, group_rows: int) -> None:
        self._writer, self._schema, self._group_rows = source, schema, group_rows
        self._columns = texts(schema.metadata)[COLUMNS]
        self._parts: list[Any] = []
        """Rows of the next row group."""

    def add(self, columns: Mapping[str, Sequence[Any]]) -> None:
        """Add rows; raises OSError."""
        self._add(_pyarrow()[0].Table.from_pydict(dict(columns), schema=self._schema))

    def copy(self, path: Path, rows: int) -> None:
        """Add the first rows of another table with the same columns; raises OSError."""
        source = opened(path)
        try:
            for number in range(source.num_row_groups):
                part = source.read_row_group(number).slice(0, rows)
                rows -= part.num_rows
                self._add(part.cast(self._schema))
                if rows <= 0:
                    return
        finally:
            source.close()

    def _add(self, part: Any) -> None:
        self._parts.append(part)
        if sum(one.num_rows for one in self._parts) >= self._group_rows:
            self._flush()

    def _flush(self) -> None:
        if self._parts:
            parts, self._parts = self._parts, []
            self._writer.write_table(_pyarrow()[0].concat_tables(parts))

    def describe(self, about: Mapping[str, str]) -> None:
        """Replace the metadata with which the table was begun; call it before ``close``."""
        # Readers take the schema's metadata from the copy of the schema in "ARROW:schema".
        about = {**about, COLUMNS: self._columns}
        schema = self._schema.with_metadata(about)
        copy = base64.b64encode(schema.serialize().to_pybytes()).decode("ascii")
        self._writer.add_key_value_metadata({**about, "ARROW:schema": copy})

    def close(self) -> None:
        """Write the end of the file, without which the file is unreadable; raises OSError."""
        try:
            self._flush()
        finally:
            self._writer.close()


def writer(
    target: Path | IO[bytes],
    fields: Sequence[Field],
    about: Mapping[str, str],
    group_rows: int = GROUP_ROWS,
) -> Writer:
    """Begin a table.

    The metadata of each field contains its unit and meaning; the metadata of the schema contains
    ``about``.
    """
    arrow, files = _pyarrow()
    types = {
        "float": arrow.float64(),
        "int": arrow.int64(),
        "bool": arrow.bool_(),
        "text": arrow.string(),
    }
    schema = arrow.schema(
        [
            arrow.field(
                one.name, types[one.kind], metadata={"unit": one.unit, "meaning": one.meaning}
            )
            for one in fields
        ],
        metadata={**about, COLUMNS: _described(fields)},
    )
    return Writer(files.ParquetWriter(target, schema, compression="zstd"), schema, group_rows)


def _described(fields: Sequence[Field]) -> str:
    columns = {one.name: {"unit": one.unit, "meaning": one.meaning} for one in fields}
    return json.dumps(columns, ensure_ascii=False)


@contextmanager
def writing(
    target: Path | IO[bytes],
    fields: Sequence[Field],
    about: Mapping[str, str],
    group_rows: int = GROUP_ROWS,
) -> Generator[Writer]:
    """Write a table, and close it at the end of the block; raises OSError."""
    begun = writer(target, fields, about, group_rows)
    try:
        yield begun
    finally:
        begun.close()


def write(
    target: Path | IO[bytes],
    fields: Sequence[Field],
    columns: Mapping[str, Sequence[Any]],
    about: Mapping[str, str],
) -> None:
    """Write a table that is in memory."""
    with writing(target, fields, about) as begun:
        begun.add(columns)


def opened(source: Path | IO[bytes]) -> Any:
    """Open a table to read it in parts; raises OSError if it cannot be read."""
    return _pyarrow()[1].ParquetFile(source)


def read_about(path: Path) -> dict[str, str]:
    """Read the metadata of a table; raises as ``parts`` does."""
    source = opened(path)
    try:
        return about_of(source.schema_arrow)
    finally:
        source.close()


def names_of(source: Path | IO[bytes]) -> list[str]:
    """Return the names of a table's columns; raises as ``parts`` does."""
    file = opened(source)
    try:
        return file.schema_arrow.names
    finally:
        file.close()


def about_of(schema: Any) -> dict[str, str]:
    """Return the metadata with which a table was written, without the metadata of its columns."""
    return {name: text for name, text in texts(schema.metadata).items() if name != COLUMNS}


def fields_of(schema: Any) -> list[Field]:
    """Return the properties of a table's columns."""
    about = [texts(one.metadata) for one in schema]
    return [
        Field(one.name, told.get("unit", ""), told.get("meaning", ""), KINDS[str(one.type)])
        for one, told in zip(schema, about, strict=True)
    ]


def texts(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    """Decode metadata of a table or of one of its columns."""
    return {key.decode(): value.decode() for key, value in (metadata or {}).items()}


def parts(
    source: Path | IO[bytes], columns: Sequence[str] | None = None
) -> Iterator[dict[str, list[Any]]]:
    """Read a table part by part; raises OSError, or ValueError if it is no table."""
    file = opened(source)
    try:
        for batch in file.iter_batches(PART_ROWS, columns=columns):
            yield batch.to_pydict()
    finally:
        file.close()


def _pyarrow() -> tuple[Any, Any]:
    """Return the package, which has no type annotations, and its module for files."""
    # Imported for the first table: it takes a tenth of the start time of a program that may never
    # need it.
    import pyarrow.parquet

    return pyarrow, pyarrow.parquet
