"""Texts of pincette for values that a pydantic model refuses.

The code and the numbers of an error are stable; pydantic's own text is for programmers, and changes
with its versions.
"""

from collections.abc import Mapping, Sequence
from reprlib import Repr
from typing import Any

KNOWN: Mapping[str, str] = {
    "missing": "is missing: state it",
    "extra_forbidden": "is not a known name: omit it",
    "greater_than": "must be above {gt:g}{unit}",
    "greater_than_equal": "must be {ge:g}{unit} or more",
    "less_than": "must be below {lt:g}{unit}",
    "less_than_equal": "must be {le:g}{unit} or less",
    "multiple_of": "must be a multiple of {multiple_of:g}{unit}",
    "finite_number": "must be a finite number",
    "int_from_float": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_parsing_size": "must be a whole number of fewer digits",
    "string_too_short": "must have {min_length} or more characters",
    "string_too_long": "must have {max_length} characters at most",
    "string_pattern_mismatch": "must have the form {pattern}",
    "string_unicode": "must be valid Unicode",
    "too_short": "must have {min_length} or more entries, has {actual_length}",
    "too_long": "must have {max_length} entries at most, has {actual_length}",
    "literal_error": "must be {expected}",
    "enum": "must be {expected}",
    "none_required": "must be null",
    "union_tag_invalid": "must be one of {expected_tags}",
    "timezone_aware": "must state its time zone, such as 2026-03-01T12:00:00Z",
    "json_invalid": "is not JSON: {error}",
    "law": "{text}",
}
"""Texts by the code of an error, with placeholders for its numbers."""
KINDS: Mapping[str, str] = {
    "float": "a number",
    "int": "a whole number",
    "decimal": "a number",
    "bool": "true or false",
    "string": "a text",
    "bytes": "bytes",
    "list": "a list",
    "tuple": "a list",
    "set": "a list",
    "frozen_set": "a list",
    "dict": "an object",
    "mapping": "an object",
    "model": "an object",
    "dataclass": "an object",
    "datetime": "a time, such as 2026-03-01T12:00:00Z",
    "date": "a date, such as 2026-03-01",
    "time": "a time of day",
    "path": "a path",
    "url": "an address, such as https://example.org/path",
}
"""Name of the expected type for a value of a wrong type, by the first word of the error code."""
BRANCHES = ("float", "int", "str", "bool")
"""Names of types that pydantic adds to the path of a field if its value may have several types."""


class _ValueFormat(Repr):
    """Python's representation, but with true, false and null, as in JSON and TOML."""

    def __init__(self, longest: int) -> None:
        super().__init__()
        self.maxstring = self.maxlong = self.maxother = longest
        self.maxlevel = 3

    def repr_bool(self, value: bool, _level: int) -> str:
        return "true" if value else "false"

    def repr_NoneType(self, _value: None, _level: int) -> str:
        return "null"


def value_text(value: object, longest: int = 160) -> str:
    """Return a value for a message, with true, false and null as in JSON and TOML.

    Texts and lists longer than ``longest`` characters and 6 entries are shortened.
    """
    return _ValueFormat(longest).repr(value)


def place(loc: Sequence[str | int]) -> str:
    """Return the path of fields that leads to a value, such as ``realtime.cores.0``, from ``loc``
    of an error.
    """
    return ".".join(
        str(part)
        for part in loc
        if isinstance(part, int)
        or not ("[" in part or part.startswith("constrained-") or part in BRANCHES)
    )


def refusal(error: Mapping[str, Any], unit: str = "") -> str:
    """Return what is expected of a value, from an entry of pydantic's ``errors``.

    An example is ``must be above 0 mN``. A text that one of pincette's own validators has raised is
    returned unchanged.
    """
    code, context = str(error["type"]), dict(error.get("ctx") or {})
    if code in ("value_error", "assertion_error"):
        return str(error["msg"]).partition(", ")[2] or str(error["msg"])
    known = KNOWN.get(code)
    if known is not None:
        try:
            return known.format(**context, unit=f" {unit}" if unit else "")
        except (KeyError, ValueError):  # a number is missing or is not a number
            pass
    kind = next((name for name in KINDS if code.startswith(f"{name}_")), "")
    return f"must be {KINDS[kind]}" if kind else "cannot be used here"
