"""Columns as Parquet, each with its unit and its meaning; the only file that imports pyarrow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal

Kind = Literal["float", "int", "bool", "text"]


@dataclass(frozen=True, slots=True)
class Field:
    """What a column is."""

    name: str
    unit: str
    meaning: str
    kind: Kind


def write(
    target: Path | BinaryIO,
    fields: Sequence[Field],
    columns: Mapping[str, Sequence[Any]],
    about: Mapping[str, str],
) -> None:
    """Write a table; each field's metadata holds its unit and meaning, the schema's ``about``."""
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
    table = arrow.Table.from_pydict(dict(columns), schema=schema)
    files.write_table(table, target, compression="zstd")


def opened(path: Path) -> Any:
    """A table, to be read by parts; raises OSError where it cannot be."""
    return _pyarrow()[1].ParquetFile(path)


def _pyarrow() -> tuple[Any, Any]:
    """The package, which carries no types, and its part for files."""
    # Loaded with the first table: a tenth of the start of a program that may never see one.
    import pyarrow.parquet

    return pyarrow, pyarrow.parquet
