"""Messages to MessagePack maps with named fields, and back, with every field checked.

A decoder is built once for each message from its annotations; nothing is looked up by reflection
while samples travel. A field that is missing, unknown, of the wrong type, not finite or too long
refuses the whole message.
"""

import types
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from math import isfinite
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import msgpack as untyped_msgpack

from pincette.messages import Document, Message
from pincette.topics import QUESTIONS, TOPICS

# The package ships no types.
msgpack = cast(Any, untyped_msgpack)

ENCODING = "application/msgpack"
MAX_BYTES = 65536
MAX_TEXT = 400
MAX_DOCUMENT = 32_768
MAX_ITEMS = 4096

M = TypeVar("M", bound=Message)
Reader = Callable[[str, Any], Any]


class CodecError(ValueError):
    """Bytes that are not the message they should be; the text names message, field and value."""


def encode(message: Message) -> bytes:
    """Message to bytes."""
    return _ENCODERS[type(message)](message)


def decode(kind: type[M], payload: bytes) -> M:
    """Bytes to a message of this kind.

    Raises
    ------
    CodecError
        Where the payload is not exactly such a message.
    """
    if len(payload) > MAX_BYTES:
        raise CodecError(f"{kind.__name__}: {len(payload)} bytes, limit {MAX_BYTES}")
    try:
        tree = msgpack.unpackb(payload)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
        raise CodecError(f"{kind.__name__}: not MessagePack ({error})") from error
    return cast(M, _READERS[kind](kind.__name__, tree))


def _plain(value: Any) -> Any:
    """Nested data without its classes."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, tuple):
        return [_plain(item) for item in cast("tuple[Any, ...]", value)]
    return value


def _encoder(kind: type) -> Callable[[Any], bytes]:
    names = [field.name for field in fields(kind)]
    pack = msgpack.Packer().pack
    hints = get_type_hints(kind)
    # A literal map in one expression is several times faster than a loop over field names.
    body = ", ".join(
        f"{name!r}: plain(m.{name})" if _is_nested(hints[name]) else f"{name!r}: m.{name}"
        for name in names
    )
    to_map = eval(f"lambda m: {{{body}}}", {"plain": _plain})
    return lambda message: cast(bytes, pack(to_map(message)))


def _is_nested(hint: Any) -> bool:
    """Whether a field may hold data with fields of its own."""
    return is_dataclass(hint) or any(is_dataclass(part) for part in get_args(hint))


def _float(place: str, value: Any) -> float:
    if type(value) is float:
        if isfinite(value):
            return value
        raise CodecError(f"{place} = {value}: not a finite number")
    if type(value) is int and abs(value) < 2**53:
        return float(value)
    raise CodecError(f"{place} = {str(value)[:40]!r}: not a number")


def _int(place: str, value: Any) -> int:
    if type(value) is not int:
        raise CodecError(f"{place} = {str(value)[:40]!r}: not a whole number")
    return value


def _bool(place: str, value: Any) -> bool:
    if type(value) is not bool:
        raise CodecError(f"{place} = {str(value)[:40]!r}: neither true nor false")
    return value


def _text(place: str, value: Any) -> str:
    if type(value) is not str or len(value) > MAX_TEXT:
        raise CodecError(f"{place}: not a text of at most {MAX_TEXT} characters")
    return value


def _document(place: str, value: Any) -> str:
    if type(value) is not str or len(value) > MAX_DOCUMENT:
        raise CodecError(f"{place}: not a text of at most {MAX_DOCUMENT} characters")
    return value


_SIMPLE: dict[Any, Reader] = {
    float: _float,
    int: _int,
    bool: _bool,
    str: _text,
    Document: _document,
}


def _reader(hint: Any) -> Reader:
    if hint in _SIMPLE:
        return _SIMPLE[hint]
    if is_dataclass(hint):
        return _record_reader(cast(type, hint))
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        (inner,) = (_reader(item) for item in arguments if item is not type(None))
        return lambda place, value: None if value is None else inner(place, value)
    if origin is Literal:
        return _choice_reader(arguments)
    if origin is tuple:
        return _list_reader(_reader(arguments[0]))
    raise TypeError(f"a message cannot carry {hint}")


def _choice_reader(choices: tuple[Any, ...]) -> Reader:
    def read(place: str, value: Any) -> Any:
        if value not in choices:
            raise CodecError(f"{place} = {str(value)[:40]!r}: not one of {', '.join(choices)}")
        return value

    return read


def _list_reader(item: Reader) -> Reader:
    def read(place: str, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list) or len(cast("list[Any]", value)) > MAX_ITEMS:
            raise CodecError(f"{place}: not a list of at most {MAX_ITEMS} items")
        return tuple(item(place, entry) for entry in cast("list[Any]", value))

    return read


def _record_reader(kind: type) -> Reader:
    hints = get_type_hints(kind)
    readers = [(field.name, _reader(hints[field.name])) for field in fields(kind)]
    names = {name for name, _ in readers}

    def read(place: str, value: Any) -> Any:
        if not isinstance(value, dict):
            raise CodecError(f"{place}: not a map")
        tree = cast("dict[Any, Any]", value)
        if tree.keys() != names:
            odd = ", ".join(sorted(str(name)[:40] for name in names ^ tree.keys()))
            raise CodecError(f"{place}: fields missing or unknown: {odd}")
        try:
            return kind(*[reader(name, tree[name]) for name, reader in readers])
        except CodecError as error:
            raise CodecError(f"{place}.{error}") from None
        except ValueError as error:  # data that refuses itself
            raise CodecError(f"{place}: {error}") from error

    return read


_KINDS = {topic.message for topic in TOPICS} | {
    kind for question in QUESTIONS for kind in (question.request, question.reply)
}
_ENCODERS = {kind: _encoder(kind) for kind in _KINDS}
_READERS = {kind: _record_reader(kind) for kind in _KINDS}
