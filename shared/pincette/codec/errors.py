"""Why bytes are refused, in words that are safe to log whatever the bytes were."""

from collections.abc import Iterable
from typing import Any

SHOWN = 40
"""Characters of a value that a refusal repeats."""
NAMED = 5
"""Fields that a refusal names."""


class CodecError(ValueError):
    """Bytes that are not the message they should be; the text names message, field and value."""


class FieldsError(CodecError):
    """A map whose fields are not those of the message."""


def shown(value: Any) -> str:
    """A value in a refusal: short, on one line; of what holds other values only the kind."""
    if value is None or isinstance(value, str | bool | int | float):
        return repr(str(value)[:SHOWN])
    return f"({type(value).__name__})"


def named(fields: Iterable[Any]) -> str:
    """Names of fields in a refusal, a few of them."""
    names = sorted(_plain(field) for field in fields)
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def _plain(field: Any) -> str:
    legible = isinstance(field, str) and field.isprintable() and len(field) <= SHOWN
    return field if legible else repr(field[:SHOWN])
