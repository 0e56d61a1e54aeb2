"""Base class of records that are created in every tick or sent: frozen msgspec structures."""

import dataclasses
from typing import Any, TypeVar

from msgspec import Struct, structs

T = TypeVar("T")


class FrozenRecord(Struct, frozen=True, forbid_unknown_fields=True):
    """A frozen record; ``msgspec.structs.replace`` copies it with changed fields in 0.1 µs."""


def field_names(value: object) -> tuple[str, ...] | None:
    """Return the field names of a record or dataclass, or of its class; None for anything else."""
    kind: Any = value if isinstance(value, type) else type(value)
    if issubclass(kind, Struct):
        return kind.__struct_fields__
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind))
    return None


def replace(value: T, **changes: Any) -> T:
    """Return a copy of a record or a dataclass with other values of some fields."""
    whole: Any = value
    if isinstance(whole, Struct):
        made: Any = structs.replace(whole, **changes)
    else:
        made = dataclasses.replace(whole, **changes)
    return made
