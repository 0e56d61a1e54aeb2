"""Reasons why a payload is refused, as texts that are safe to log whatever the payload contains.

A refused payload is decoded again, slowly, with the package ``msgpack`` and compared with the types
of the message's fields. The text names field, value, unit and limit.
"""

from collections.abc import Iterable
from functools import cache
from math import inf, isfinite
from typing import Any, cast

import msgpack as untyped_msgpack
from msgspec import inspect

from pincette.control.quantities import MAX_ITEMS, MAX_TEXT

# The package has no type annotations.
msgpack = cast(Any, untyped_msgpack)

MAX_FIELDS = 64
"""Largest number of fields of a map, whether known or unknown."""
SHOWN = 40
"""Number of characters of a value that a refusal shows."""
MOST_CHOICES = 12
"""Number of choices that a refusal lists."""
NAMED = 5
"""Number of fields that a refusal names."""
FEW = 16
"""Number of list items that are read for a message without lists: enough to name the field."""


class CodecError(ValueError):
    """Error for bytes that are not the expected message; the text names message, field and
    value.
    """


class FieldsError(CodecError):
    """Error for a map whose fields differ from those of the message."""


def read_slowly(kind: type, payload: bytes) -> None:
    """Find what is wrong with a payload; raises CodecError. Returns if the payload is valid.

    The package ``msgpack`` reserves memory for the length stated in a list's header before it reads
    the items, and lists may be nested. The length of a list is therefore limited before it is read;
    most messages have no list.
    """
    name, node = kind.__name__, _node(kind)
    try:
        tree = msgpack.unpackb(
            payload,
            object_pairs_hook=_distinct,
            max_array_len=MAX_ITEMS if _has_list(node) else FEW,
            max_map_len=MAX_FIELDS,
            max_bin_len=0,
            max_ext_len=0,
        )
    except FieldsError as error:
        raise FieldsError(f"{name}: {error}") from None
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        raise CodecError(f"{name}: not MessagePack ({error})") from None
    _value(name, node, tree)


def short_texts(kind: type) -> list[str]:
    """Return the names of the short text fields that a message itself has."""
    return [
        name
        for name, node in _own_fields(kind)
        if isinstance(node, inspect.StrType) and node.max_length == MAX_TEXT
    ]


def largest_floats(kind: type) -> list[tuple[str, float]]:
    """Return the float fields that a message itself has, with their largest magnitude; optional
    fields are included.
    """
    found: list[tuple[str, float]] = []
    for name, node in _own_fields(kind):
        parts = node.types if isinstance(node, inspect.UnionType) else (node,)
        floats = [part.type if isinstance(part, inspect.Metadata) else part for part in parts]
        found += [(name, _limits(one)[1]) for one in floats if isinstance(one, inspect.FloatType)]
    return found


def _own_fields(kind: type) -> list[tuple[str, inspect.Type]]:
    node = _node(kind)
    assert isinstance(node, inspect.StructType)
    return [(field.name, field.type) for field in node.fields]


def unit_stated(node: inspect.Metadata) -> str:
    """Return the unit that a field's type states, or an empty text."""
    # msgspec declares no type for the items of ``extra``.
    told = node.extra  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
    return cast("dict[str, str]", told)["unit"] if told else ""


@cache
def _node(kind: type) -> inspect.Type:
    return inspect.type_info(kind)


def _distinct(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    """Return a map from pairs.

    A map that contains a field twice is refused, since decoders may interpret it differently.
    """
    tree = dict(pairs)
    if len(tree) < len(pairs):
        names = [name for name, _ in pairs]
        raise FieldsError(f"fields twice: {_named({n for n in names if names.count(n) > 1})}")
    return tree


def _has_list(node: inspect.Type) -> bool:
    match node:
        case inspect.VarTupleType():
            return True
        case inspect.StructType():
            return any(_has_list(field.type) for field in node.fields)
        case inspect.UnionType():
            return any(_has_list(item) for item in node.types)
        case _:
            return False


def _value(place: str, node: inspect.Type, value: Any, unit: str = "") -> Any:
    match node:
        case inspect.Metadata():
            return _value(place, node.type, value, unit_stated(node))
        case inspect.FloatType():
            return _number(place, node, value, unit)
        case inspect.IntType():
            return _whole(place, node, value)
        case inspect.BoolType():
            if type(value) is bool:
                return value
            raise CodecError(f"{place} = {_shown(value)}: neither true nor false")
        case inspect.StrType():
            return _text(place, node, value)
        case inspect.StructType():
            return _record(place, node, value)
        case inspect.UnionType():
            return _one_of(place, node, value)
        case inspect.LiteralType():
            return _choice(place, node.values, value)
        case inspect.EnumType():
            return node.cls(_choice(place, [item.value for item in node.cls], value))
        case inspect.VarTupleType():
            if type(value) is list:
                items = cast("list[Any]", value)
                return tuple([_value(place, node.item_type, item) for item in items])
            raise CodecError(f"{place} = {_shown(value)}: not a list")
        case _:
            raise TypeError(f"a message cannot carry {node}")


def _one_of(place: str, node: inspect.UnionType, value: Any) -> Any:
    """Check a value that may be None or one of several records, distinguished by a tag."""
    inner = [item for item in node.types if not isinstance(item, inspect.NoneType)]
    if value is None and len(inner) < len(node.types):
        return None
    if len(inner) == 1:
        return _value(place, inner[0], value)
    records = {item.tag: item for item in inner if isinstance(item, inspect.StructType)}
    tag_field = next(iter(records.values())).tag_field
    tree = _map(place, value)
    if tag_field not in tree:
        raise FieldsError(f"{place}: fields missing or unknown: {tag_field}")
    return _record(place, records[_choice(f"{place}.{tag_field}", records, tree[tag_field])], tree)


def _map(place: str, value: Any) -> dict[Any, Any]:
    if type(value) is not dict:
        raise CodecError(f"{place}: not a map")
    return cast("dict[Any, Any]", value)


def _record(place: str, node: inspect.StructType, value: Any) -> Any:
    tree = _map(place, value)
    fields = {field.name: field.type for field in node.fields}
    tags: set[Any] = set() if node.tag_field is None else {node.tag_field}
    if tree.keys() - tags != fields.keys():
        odd = fields.keys() ^ (tree.keys() - tags)
        raise FieldsError(f"{place}: fields missing or unknown: {_named(odd)}")
    values = {name: _value(f"{place}.{name}", fields[name], tree[name]) for name in fields}
    try:
        return node.cls(**values)
    except ValueError as error:  # a value whose conversion fails
        raise CodecError(f"{place}: {error}") from error


def _limits(node: inspect.FloatType | inspect.IntType) -> tuple[float, float]:
    return -inf if node.ge is None else node.ge, inf if node.le is None else node.le


def _number(place: str, node: inspect.FloatType, value: Any, unit: str) -> float:
    least, most = _limits(node)
    if type(value) in (int, float) and least <= value <= most:
        return float(value)
    limit = f"beyond ±{most:g} {unit}".rstrip()
    if type(value) is float:
        why = limit if isfinite(value) else "not a finite number"
        raise CodecError(f"{place} = {value:g} {unit}".rstrip() + f": {why}")
    why = limit if type(value) is int else "not a number"
    raise CodecError(f"{place} = {_shown(value)}: {why}")


def _whole(place: str, node: inspect.IntType, value: Any) -> int:
    if type(value) is not int:
        raise CodecError(f"{place} = {_shown(value)}: not a whole number")
    least, most = _limits(node)
    if least <= value <= most:
        return value
    raise CodecError(f"{place} = {value}: not within {least} to {most}")


def _text(place: str, node: inspect.StrType, value: Any) -> str:
    if type(value) is not str:
        raise CodecError(f"{place} = {_shown(value)}: not a text")
    if node.max_length is not None and len(value) > node.max_length:
        raise CodecError(
            f"{place}: not a text of at most {node.max_length} characters, it has {len(value)}"
        )
    return value


def _choice(place: str, choices: Iterable[Any], value: Any) -> Any:
    known = [str(choice) for choice in choices]
    if type(value) is str and value in known:
        return value
    more = len(known) - MOST_CHOICES
    listed = [*known[:MOST_CHOICES], f"{more} more"] if more > 0 else known
    raise CodecError(f"{place} = {_shown(value)}: not one of {', '.join(listed)}")


def _shown(value: Any) -> str:
    """Return a value for a refusal text: short and on one line; of a container only the type."""
    if value is None or isinstance(value, str | bool | int | float):
        return repr(str(value)[:SHOWN])
    return f"({type(value).__name__})"


def _named(fields: Iterable[Any]) -> str:
    """Return some field names for a refusal text."""
    names = sorted(_legible(field) for field in fields)
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def _legible(field: Any) -> str:
    plain = isinstance(field, str) and field.isprintable() and len(field) <= SHOWN
    return field if plain else repr(field[:SHOWN])
