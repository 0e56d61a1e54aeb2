"""Plain data to records, field by field; the readers are made of a record's annotations."""

import types
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from math import isfinite
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

from pincette.codec.bounds import MAX_DOCUMENT, MAX_TEXT, largest, whole_range
from pincette.codec.errors import CodecError, FieldsError, named, shown
from pincette.messages import Document
from pincette.records.units import unit_of

OPTIONAL = (Union, types.UnionType)
BY_NAME: dict[str, Any] = {"_type": type, "_len": len}
"""What expressions call; no field has such a name."""
Reader = Callable[[str, Any], Any]
"""Takes the place of a value, for a refusal, and the value."""


def record_reader(kind: type) -> Reader:
    """Make the reader of a record: a map that has every field, and no other.

    The fields of a map mostly come in the record's own order, and are then taken as they come.
    """
    order = tuple([field.name for field in fields(kind)])
    names = set(order)
    make = _maker(kind, order)

    def read(place: str, value: Any) -> Any:
        if type(value) is not dict:
            raise CodecError(f"{place}: not a map")
        tree = cast("dict[Any, Any]", value)
        try:
            if tuple(tree) == order:
                return make(*tree.values())
            if tree.keys() == names:
                return make(**tree)
        except CodecError as error:
            raise type(error)(f"{place}.{error}") from None
        except ValueError as error:  # data that refuses itself
            raise CodecError(f"{place}: {error}") from error
        raise FieldsError(f"{place}: fields missing or unknown: {named(names ^ tree.keys())}")

    return read


def _maker(kind: type, order: tuple[str, ...]) -> Callable[..., Any]:
    """Make what takes the fields of a record, in their order, and returns it.

    What is as it should be is told in one expression, several times faster than by a call for each
    field; the field's reader is called for the rest, and says what is wrong with it. A record that
    checks nothing itself is filled slot by slot, in half the time that its constructor takes.
    """
    hints = get_type_hints(kind)
    readers = {f"_read_{name}": _reader(hints[name], name) for name in order}
    values = {name: _expression(name, hints[name]) for name in order}
    if hasattr(kind, "__post_init__") or not hasattr(kind, "__slots__"):
        make = f"lambda {', '.join(order)}: _kind({', '.join(values.values())})"
        return eval(make, readers | BY_NAME | {"_kind": kind})
    slots = {f"_set_{name}": vars(kind)[name].__set__ for name in order}
    filled = [f"_set_{name}(_record, {values[name]})" for name in order]
    lines = (f"def make({', '.join(order)}):", "_record = _new(_kind)", *filled, "return _record")
    scope: dict[str, Any] = readers | slots | BY_NAME | {"_kind": kind, "_new": object.__new__}
    exec("\n ".join(lines), scope)
    return scope["make"]


def _expression(name: str, hint: Any) -> str:
    """What gives the value of a field that came as the argument of its name."""
    read = f"_read_{name}({name!r}, {name})"
    sound = _sound(name, hint)
    return f"{name} if {sound} else {read}" if sound else read


def _sound(name: str, hint: Any) -> str:
    """Whether a field's argument is as it should be; empty where that takes its reader."""
    if hint is float:
        bound = largest(name)
        return f"_type({name}) is float and {-bound!r} <= {name} <= {bound!r}"
    if hint is int:
        least, most = whole_range(name)
        return f"_type({name}) is int and {least} <= {name} <= {most}"
    if hint is bool:
        return f"_type({name}) is bool"
    if hint is str:
        return f"_type({name}) is str and _len({name}) <= {MAX_TEXT}"
    if get_origin(hint) in OPTIONAL:
        (inner,) = (item for item in get_args(hint) if item is not type(None))
        return " or ".join(filter(None, (f"{name} is None", _sound(name, inner))))
    return ""


def _reader(hint: Any, name: str) -> Reader:
    if hint is float:
        return _number_reader(name)
    if hint is int:
        return _int_reader(name)
    if hint is bool:
        return _bool
    if hint in (str, Document):
        return _text_reader(MAX_TEXT if hint is str else MAX_DOCUMENT)
    if is_dataclass(hint):
        return record_reader(cast(type, hint))
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in OPTIONAL:
        (inner,) = (_reader(item, name) for item in arguments if item is not type(None))
        return lambda place, value: None if value is None else inner(place, value)
    if origin is Literal:
        return _choice_reader(arguments)
    if origin is tuple:
        return _list_reader(_reader(arguments[0], name))
    raise TypeError(f"a message cannot carry {hint}")


def _number_reader(name: str) -> Reader:
    bound, unit = largest(name), unit_of(name)
    limit = f"beyond ±{bound:g} {unit}".rstrip()

    def read(place: str, value: Any) -> float:
        # What is not a number lies within no bounds.
        if type(value) is float and -bound <= value <= bound:
            return value
        if type(value) is int and -bound <= value <= bound:
            return float(value)
        if type(value) is float:
            why = limit if isfinite(value) else "not a finite number"
            raise CodecError(f"{place} = {value:g} {unit}".rstrip() + f": {why}")
        why = limit if type(value) is int else "not a number"
        raise CodecError(f"{place} = {shown(value)}: {why}")

    return read


def _int_reader(name: str) -> Reader:
    least, most = whole_range(name)

    def read(place: str, value: Any) -> int:
        if type(value) is not int:
            raise CodecError(f"{place} = {shown(value)}: not a whole number")
        if least <= value <= most:
            return value
        raise CodecError(f"{place} = {value}: not within {least} to {most}")

    return read


def _bool(place: str, value: Any) -> bool:
    if type(value) is not bool:
        raise CodecError(f"{place} = {shown(value)}: neither true nor false")
    return value


def _text_reader(longest: int) -> Reader:
    def read(place: str, value: Any) -> str:
        if type(value) is not str:
            raise CodecError(f"{place} = {shown(value)}: not a text")
        if len(value) > longest:
            raise CodecError(
                f"{place}: not a text of at most {longest} characters, it has {len(value)}"
            )
        return value

    return read


def _choice_reader(choices: tuple[Any, ...]) -> Reader:
    def read(place: str, value: Any) -> Any:
        if type(value) is str and value in choices:
            return value
        raise CodecError(f"{place} = {shown(value)}: not one of {', '.join(choices)}")

    return read


def _list_reader(item: Reader) -> Reader:
    def read(place: str, value: Any) -> tuple[Any, ...]:
        if type(value) is not list:
            raise CodecError(f"{place} = {shown(value)}: not a list")
        return tuple([item(place, entry) for entry in cast("list[Any]", value)])

    return read
