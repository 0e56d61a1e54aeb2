"""MessagePack to plain data, with what an attacker could make large bounded beforehand."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, cast, get_args, get_origin, get_type_hints

import msgpack as untyped_msgpack

from pincette.codec.bounds import MAX_BYTES, MAX_FIELDS, MAX_ITEMS
from pincette.codec.errors import CodecError, FieldsError, named

# The package ships no types.
msgpack = cast(Any, untyped_msgpack)

FEW = 16
"""Items of a list where the message has none: enough for the refusal to name the field."""
SHORT_MAP = 16
"""Fields from which on the header of a map takes three bytes."""
Unpack = Callable[[bytes], Any]


def unpacker(kind: type) -> Unpack:
    """Make the unpacker of one message.

    It reserves memory as a list's header asks, before the items come, and lists may nest; so the
    length of a list is bounded before it is read, and most messages have none.
    """
    longest = MAX_ITEMS if _has_list(kind) else FEW
    unpackb = msgpack.unpackb
    hints = get_type_hints(kind)
    nested = tuple(field.name for field in fields(kind) if _nests(hints[field.name]))
    name, head = kind.__name__, _head(len(fields(kind)))

    def carefully(payload: bytes) -> Any:
        return unpackb(
            payload,
            object_pairs_hook=_distinct,
            max_array_len=longest,
            max_map_len=MAX_FIELDS,
            max_bin_len=0,
            max_ext_len=0,
        )

    def unpack(payload: bytes) -> Any:
        if len(payload) > MAX_BYTES:
            raise CodecError(f"{name}: {len(payload)} bytes, limit {MAX_BYTES}")
        try:
            # Written out: a partial would merge the limits anew for each message, which takes as
            # long as unpacking.
            tree = unpackb(
                payload,
                max_array_len=longest,
                max_map_len=MAX_FIELDS,
                max_bin_len=0,
                max_ext_len=0,
            )
            if not payload.startswith(head):
                return carefully(payload)
            for field in nested:
                if tree.get(field) is not None:
                    return carefully(payload)
        except FieldsError as error:
            raise FieldsError(f"{name}: {error}") from None
        except (ValueError, TypeError, RecursionError, msgpack.UnpackException) as error:
            raise CodecError(f"{name}: not MessagePack ({error})") from None
        return tree

    return unpack


def _head(count: int) -> bytes:
    """The begin of a map of so many fields; where it is there, none of them is there twice."""
    return bytes([0x80 | count]) if count < SHORT_MAP else b"\xde" + count.to_bytes(2)


def _distinct(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    """A map of pairs; one that has a field twice would be read otherwise by another reader."""
    tree = dict(pairs)
    if len(tree) < len(pairs):
        names = [name for name, _ in pairs]
        raise FieldsError(f"fields twice: {named({n for n in names if names.count(n) > 1})}")
    return tree


def _nests(hint: Any) -> bool:
    """Whether a field may hold data with fields of its own."""
    return is_dataclass(hint) or any(_nests(part) for part in get_args(hint))


def _has_list(hint: Any) -> bool:
    """Whether a message has a list anywhere."""
    if get_origin(hint) is tuple:
        return True
    if is_dataclass(hint):
        return any(_has_list(part) for part in get_type_hints(hint).values())
    return any(_has_list(part) for part in get_args(hint))
