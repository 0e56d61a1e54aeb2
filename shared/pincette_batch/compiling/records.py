"""Records and dataclasses as tuples with names, or as one record in memory: what a compiler knows.

A tuple is handed over value by value, which suits a state; a record by its place, which suits the
hundreds of constants that a kernel hands on from function to function.
"""

import collections
from functools import cache
from importlib import import_module
from typing import Any, cast

import numpy as np

from pincette.control.record import field_names


@cache
def record_type(kind: type) -> Any:
    """Tuple type with the fields of a record or a dataclass, in their order.

    Machine code is kept under the types of its arguments, and another process finds it only where
    these are told by name: here the path of the class, which is an attribute of this module.
    """
    # Its fields are known at run time alone.
    made: Any = collections.namedtuple
    found = made(kind.__name__, field_names(kind))
    found.__module__, found.__qualname__ = __name__, _path_of(kind)
    return found


def __getattr__(path: str) -> Any:
    module, found, name = path.partition(":")
    if not found:
        raise AttributeError(f"module {__name__!r} has no attribute {path!r}")
    return record_type(getattr(import_module(module.replace("/", ".")), name))


def _path_of(kind: type) -> str:
    """Without dots, which would be read as attributes of attributes."""
    return f"{kind.__module__.replace('.', '/')}:{kind.__qualname__}"


def as_record(value: Any) -> Any:
    """A record or a dataclass, and those within it and within tuples, as tuples with names."""
    names = field_names(value)
    if names is not None:
        return record_type(value.__class__)(*(as_record(getattr(value, name)) for name in names))
    if isinstance(value, tuple):
        parts = [as_record(part) for part in cast("tuple[Any, ...]", value)]
        named: Any = type(cast(object, value))
        return named(*parts) if hasattr(named, "_fields") else tuple(parts)
    return value


def as_structure(value: Any) -> Any:
    """A flat record's numbers, and those within it, as one record of NumPy's.

    Plain tuples become arrays, of which all numbers have one type.
    """
    found = np.zeros(1, _layout(value))
    found[0] = _numbers(value)
    return found[0]


def _parts(value: Any) -> dict[str, Any] | None:
    """By name; none where it has no named ones."""
    names = field_names(value)
    if names is None:
        names = cast("tuple[str, ...]", getattr(value, "_fields", ()))
    return {name: getattr(value, name) for name in names} or None


def _layout(value: Any) -> Any:
    parts = _parts(value)
    if parts is None:
        plain = np.asarray(value)
        return (plain.dtype, plain.shape) if plain.shape else plain.dtype
    named: list[Any] = []
    for name, part in parts.items():
        layout = _layout(part)
        named.append((name, *layout) if isinstance(layout, tuple) else (name, layout))
    return np.dtype(named, align=True)


def _numbers(value: Any) -> Any:
    parts = _parts(value)
    return value if parts is None else tuple(_numbers(part) for part in parts.values())
