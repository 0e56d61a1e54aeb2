"""Each type of message refuses invalid values; its fields state their limits."""

import math
import random
from collections.abc import Iterator
from typing import Any

import pytest
from msgspec import Struct, inspect

from pincette.core.codec import KINDS, decode, encode
from pincette.core.codec.refusals import CodecError, msgpack, unit_stated
from pincette.core.units import unit_of
from tests.support.bounds import largest, whole_range
from tests.support.frames import BY_NAME, sound

PROMISES = {
    "list": b"\xdd\xff\xff\xff\xff",
    "map": b"\xdf\xff\xff\xff\xff",
    "text": b"\xdb\xff\xff\xff\xff",
    "bytes": b"\xc6\xff\xff\xff\xff",
    "extension": b"\xc9\xff\xff\xff\xff\x05",
}
"""Headers that announce gigabytes."""


def tree_of(name: str) -> dict[str, Any]:
    return msgpack.unpackb(encode(sound(BY_NAME[name], random.Random(20131))))


def fields_of(name: str) -> tuple[str, ...]:
    return BY_NAME[name].__struct_fields__


def packed(pairs: list[tuple[str, bytes]]) -> bytes:
    """Return a map of names and values that are already packed."""
    body = b"".join(msgpack.packb(key) + value for key, value in pairs)
    return b"\xde" + len(pairs).to_bytes(2) + body


def leaves(node: inspect.Type, name: str = "") -> Iterator[tuple[str, inspect.Type, str]]:
    """Return the fields without subfields: name, type, and unit."""
    match node:
        case inspect.Metadata():
            unit = unit_stated(node)
            yield from ((name, inner, unit) for _, inner, _ in leaves(node.type, name))
        case inspect.StructType():
            for field in node.fields:
                yield from leaves(field.type, field.name)
        case inspect.UnionType():
            for item in node.types:
                yield from leaves(item, name)
        case inspect.VarTupleType():
            assert node.max_length is not None, f"{name}: a list without a limit"
            yield from leaves(node.item_type, name)
        case _:
            yield name, node, ""


def test_every_field_states_its_unit_and_its_limit() -> None:
    for kind in BY_NAME.values():
        for field, node, unit in leaves(inspect.type_info(kind)):
            if isinstance(node, inspect.FloatType):
                assert (unit, node.ge, node.le) == (unit_of(field), -largest(field), largest(field))
            elif isinstance(node, inspect.IntType):
                assert (node.ge, node.le) == whole_range(field), field
            elif isinstance(node, inspect.StrType):
                assert node.max_length is not None, f"{field}: a text without a limit"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, b"x", [[]], {"a": 1}, 1 << 60])
def test_no_field_accepts_an_impossible_value(value: Any) -> None:
    for name, kind in BY_NAME.items():
        tree = tree_of(name)
        for field in tree:
            with pytest.raises(CodecError, match=rf"^{name}\b.*"):
                decode(kind, msgpack.packb(tree | {field: value}))


def test_an_unknown_field_is_named() -> None:
    for name, kind in BY_NAME.items():
        with pytest.raises(CodecError, match=f"^{name}: fields missing or unknown: colour$"):
            decode(kind, msgpack.packb(tree_of(name) | {"colour": 1}))


def test_a_missing_field_is_named_though_it_has_a_default() -> None:
    for name, kind in BY_NAME.items():
        tree = tree_of(name)
        for field in tree:
            fewer = {key: value for key, value in tree.items() if key != field}
            with pytest.raises(CodecError, match=f"^{name}: fields missing or unknown: {field}$"):
                decode(kind, msgpack.packb(fewer))


@pytest.mark.parametrize("name", [name for name in BY_NAME if "arms" in fields_of(name)])
def test_a_message_has_records_for_one_arm_or_for_two(name: str) -> None:
    tree = tree_of(name)
    arm = tree["arms"][0]
    for count in (1, 2):
        decode(BY_NAME[name], msgpack.packb(tree | {"arms": [arm] * count}))
    for count in (0, 3):
        with pytest.raises(CodecError, match=f"^{name}.*arms"):
            decode(BY_NAME[name], msgpack.packb(tree | {"arms": [arm] * count}))


def test_a_duplicate_field_is_named_even_if_another_is_missing() -> None:
    for name, kind in BY_NAME.items():
        pairs = [(key, msgpack.packb(value)) for key, value in tree_of(name).items()]
        for place, (field, _) in enumerate(pairs):
            for left in (pairs, pairs[: place - 1] + pairs[place:] if place else pairs[:-1]):
                twice = [*left, pairs[place]]
                if [key for key, _ in twice].count(field) < 2:
                    continue
                with pytest.raises(CodecError, match=f"^{name}: fields twice: {field}$"):
                    decode(kind, packed(twice))


@pytest.mark.parametrize("promise", PROMISES)
def test_a_header_that_announces_gigabytes_is_refused(promise: str) -> None:
    for name, kind in BY_NAME.items():
        fields = [(key, msgpack.packb(value)) for key, value in tree_of(name).items()]
        payloads = [PROMISES[promise]]
        payloads += [
            packed([*fields[:place], (key, PROMISES[promise])])
            for place, (key, _) in enumerate(fields)
        ]
        for payload in payloads:
            with pytest.raises(CodecError, match=f"^{name}: "):
                decode(kind, payload)


def test_the_order_of_fields_and_the_form_of_numbers_are_free() -> None:
    for name, kind in BY_NAME.items():
        tree = tree_of(name)
        backwards = dict(reversed(list(tree.items())))
        whole = {
            key: int(value) if isinstance(value, float) and value.is_integer() else value
            for key, value in backwards.items()
        }
        assert decode(kind, msgpack.packb(whole)) == decode(kind, msgpack.packb(tree))


def test_every_message_is_a_frozen_structure() -> None:
    for kind in KINDS:
        assert issubclass(kind, Struct)
        assert kind.__struct_config__.frozen
        assert kind.__struct_config__.forbid_unknown_fields
