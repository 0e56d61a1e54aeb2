"""Messages to MessagePack maps."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, cast, get_args, get_type_hints

from pincette.codec.bounds import MAX_TEXT
from pincette.codec.kinds import KINDS
from pincette.codec.unpacking import msgpack
from pincette.messages import Message


def encode(message: Message) -> bytes:
    """Message to bytes; a text of its own that is too long is cut, so that the rest is heard."""
    return _ENCODERS[type(message)](message)


def _encoder(kind: type) -> Callable[[Any], bytes]:
    pack = msgpack.Packer().pack
    hints = get_type_hints(kind)
    # A literal map in one expression is several times faster than a loop over field names.
    body = ", ".join(
        f"{field.name!r}: {_expression(field.name, hints[field.name])}" for field in fields(kind)
    )
    to_map = eval(f"lambda m: {{{body}}}", {"plain": _plain})
    return lambda message: cast(bytes, pack(to_map(message)))


def _expression(name: str, hint: Any) -> str:
    if hint is str:
        return f"m.{name}[:{MAX_TEXT}]"
    return f"plain(m.{name})" if _is_nested(hint) else f"m.{name}"


def _is_nested(hint: Any) -> bool:
    """Whether a field may hold data with fields of its own."""
    return is_dataclass(hint) or any(is_dataclass(part) for part in get_args(hint))


def _plain(value: Any) -> Any:
    """Nested data without its classes."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, tuple):
        items = cast("tuple[Any, ...]", value)  # all of one kind
        return [_plain(item) for item in items] if items and is_dataclass(items[0]) else items
    return value


_ENCODERS = {kind: _encoder(kind) for kind in KINDS}
