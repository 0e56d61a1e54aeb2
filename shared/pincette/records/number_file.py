"""Columns of numbers in a CSV or Parquet file."""

import math
from collections.abc import Sequence
from decimal import Decimal
from io import BytesIO
from pathlib import Path

from pincette.core.number_tables import FileError, encoded_table
from pincette.records import parquet

MOST_ROWS = 100_000
"""Largest number of rows of a Parquet file that is read; no path is as long."""
MOST_NAMES = 10
"""Number of column names in the text of an error."""


def rows(content: bytes, names: Sequence[str], file: str) -> list[dict[str, float]]:
    """Return the rows of a file's content, by the names of their columns.

    Raises
    ------
    FileError
        If the content cannot be read; the text begins with the name of the file.
    """
    if content.startswith(parquet.MAGIC):
        return parquet_rows(BytesIO(content), names, file)
    try:
        return encoded_table(content, names)
    except FileError as error:
        raise FileError(f"{file}, {error}") from error


def parquet_rows(source: Path | BytesIO, names: Sequence[str], file: str) -> list[dict[str, float]]:
    """Return the rows of a Parquet file; raises FileError as ``rows`` does."""
    wanted = " and ".join(names)
    found: list[dict[str, float]] = []
    try:
        columns = parquet.names_of(source)
        if any(columns.count(name) != 1 for name in names):
            shown = [*columns[:MOST_NAMES], *(["…"] if len(columns) > MOST_NAMES else [])]
            raise FileError(
                f"{file} has the columns {', '.join(shown)}, must have {wanted}, "
                "each once: rename the columns that are meant"
            )
        for part in parquet.parts(source, names):
            for values in zip(*(part[name] for name in names), strict=True):
                if not all(map(_is_number, values)):
                    raise FileError(f"{file}, row {len(found) + 1}: not numbers in {wanted}")
                found.append(dict(zip(names, map(float, values), strict=True)))
            if len(found) > MOST_ROWS:
                raise FileError(f"{file} has more than {MOST_ROWS} rows: keep fewer")
    except FileError:
        raise
    except (OSError, ValueError) as error:
        raise FileError(f"{file} cannot be read: {error}") from error
    if not found:
        raise FileError(f"{file} has no rows")
    return found


def _is_number(value: object) -> bool:
    # DuckDB writes numbers such as 0.005 as decimals.
    if isinstance(value, bool) or not isinstance(value, int | float | Decimal):
        return False
    return math.isfinite(value)
