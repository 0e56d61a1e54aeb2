"""Columns as Parquet, each with its unit and its meaning; the only file that imports pyarrow."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

Kind = Literal["float", "int", "bool", "text"]


@dataclass(frozen=True, slots=True)
class Field:
    """What a column is."""

    name: str
    unit: str
    meaning: str
    kind: Kind


class Writer:
    """Writes a table part by part; each part becomes a row group."""

    def __init__(self, source: Any, schema: Any) -> None:
        self._writer, self._schema = source, schema

    def add(self, columns: Mapping[str, Sequence[Any]]) -> None:
        """Write rows; raises OSError."""
        table = _pyarrow()[0].Table.from_pydict(dict(columns), schema=self._schema)
        self._writer.write_table(table)

    def close(self) -> None:
        """Write the end of the file, without which nothing of it can be read; raises OSError."""
        self._writer.close()


def writer(target: Path | IO[bytes], fields: Sequence[Field], about: Mapping[str, str]) -> Writer:
    """Begin a table; each field's metadata holds its unit and meaning, the schema's ``about``."""
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
        metadata=dict(about),
    )
    return Writer(files.ParquetWriter(target, schema, compression="zstd"), schema)


@contextmanager
def writing(
    target: Path | IO[bytes], fields: Sequence[Field], about: Mapping[str, str]
) -> Generator[Writer]:
    """Write a table, and close it at the end; raises OSError."""
    begun = writer(target, fields, about)
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


def opened(path: Path) -> Any:
    """A table, to be read by parts; raises OSError where it cannot be."""
    return _pyarrow()[1].ParquetFile(path)


def _pyarrow() -> tuple[Any, Any]:
    """The package, which carries no types, and its part for files."""
    # Loaded with the first table: a tenth of the start of a program that may never see one.
    import pyarrow.parquet

    return pyarrow, pyarrow.parquet
