"""Tables that contain only numbers, and the CSVW metadata that describes their columns.

True is 1, false is 0, a missing value is ``nan``, and a word is a whole number that the metadata
explains.
"""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from pincette.records.parquet import Field

MEDIA_TYPE = "application/csvm+json"
METADATA = "-metadata.json"
"""End of the name of a metadata file after the name of its table, as CSVW requires it."""
NONE = "nan"
TYPES: Mapping[str, Any] = {
    "float": "number",
    "int": "integer",
    "bool": {"base": "boolean", "format": "1|0"},
    "text": "integer",
}
"""CSVW data types by the kind of a column."""
Codes = Mapping[str, Mapping[str, int]]
"""Code of each word, by column name."""


def cells(column: Iterable[Any], codes: Mapping[str, int]) -> list[Any]:
    """Return the numbers of a column."""
    return [_number(value, codes) for value in column]


def _number(value: Any, codes: Mapping[str, int]) -> Any:
    if value is None:
        return NONE
    if isinstance(value, str):
        return codes.get(value, NONE)
    return int(value) if isinstance(value, bool) else value


def metadata(name: str, fields: Iterable[Field], codes: Codes, about: Mapping[str, str]) -> str:
    """Return the CSVW (W3C) metadata of a table with a name."""
    tree = {
        "@context": "http://www.w3.org/ns/csvw",
        "url": name,
        "null": NONE,
        "schema:additionalProperty": _pairs(about),
        "tableSchema": {"columns": [_column(one, codes.get(one.name, {})) for one in fields]},
    }
    return json.dumps(tree, indent=1, ensure_ascii=False) + "\n"


def _column(field: Field, codes: Mapping[str, int]) -> dict[str, Any]:
    column: dict[str, Any] = {"titles": field.name, "datatype": TYPES[field.kind]}
    if field.unit:
        column["schema:unitText"] = field.unit
    if field.meaning:
        column["dc:description"] = field.meaning
    if codes:
        column["schema:valueReference"] = _pairs(codes)
    return column


def _pairs(values: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [{"schema:name": name, "schema:value": value} for name, value in values.items()]
