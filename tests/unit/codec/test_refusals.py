"""Malicious payloads are refused with a message, quickly, and with little memory."""

import sys
import tracemalloc
from itertools import count
from types import FrameType
from typing import Any

import pytest

from pincette.core.codec import decode, encode
from pincette.core.codec.refusals import CodecError, msgpack
from pincette.core.messages import Burst, Command, Load, Message, Position, StatusRequest
from tests.support.frames import BOMBS, BY_NAME

MEMORY_BYTES = 48 * 2**20
"""Memory limit in bytes: the unpacker's depth times the longest list; without lists a hundredth
of it."""
CALLS, CALLS_PER_BYTE = 500, 1
"""Number of calls of Python and C functions: for a message of any length, and in addition for a
longer one."""
LONGEST_TEXT = 600
ARM = {"x_um": 12.5, "valid": True, "fault": None}
POSITION: dict[str, Any] = {"epoch": 7, "seq": 3, "t_s": 0.06, "arms": [ARM]}
packb = msgpack.packb


def refused(kind: type[Message], payload: bytes) -> tuple[str, int]:
    """Return why a payload is refused, and how many calls that takes on this thread."""
    calls = count()

    def called(_frame: FrameType, _event: str, _function: object) -> None:
        next(calls)

    sys.setprofile(called)
    try:
        decode(kind, payload)
    except CodecError as error:
        return str(error), next(calls)
    finally:
        sys.setprofile(None)
    raise AssertionError("not refused")


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_nested_bomb_is_refused_with_little_work_and_memory(bomb: str) -> None:
    for name, kind in BY_NAME.items():
        for payload in (BOMBS[bomb], b"\x81\xa3seq" + BOMBS[bomb]):
            tracemalloc.start()
            message, calls = refused(kind, payload)
            _, peak = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            assert len(message) < LONGEST_TEXT
            assert message.startswith(name)
            assert calls < CALLS + CALLS_PER_BYTE * len(payload)
            assert peak < MEMORY_BYTES


def test_a_refusal_costs_work_in_proportion_to_the_items_read() -> None:
    def calls(items: int) -> int:
        x_um = (*[1.0] * items, float("nan"))
        message, calls = refused(Burst, encode(Burst(3, 0, 1000.0, x_um, x_um)))
        assert "not a finite number" in message
        return calls

    base, few, many = calls(0), calls(100) - calls(0), calls(1000) - calls(0)
    assert few > 100
    assert many == 10 * few, (base, few, many)


def test_a_message_without_lists_reserves_no_space_for_them() -> None:
    tracemalloc.start()
    with pytest.raises(CodecError):
        decode(Position, BOMBS["long lists in long lists"])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**20


def test_the_refusal_of_deep_nesting_in_a_field_does_not_print_the_value() -> None:
    deep: object = 1.0
    for _ in range(800):
        deep = [deep]
    with pytest.raises(CodecError, match=r"^Position\.arms\.x_um = \(list\): not a number$"):
        decode(Position, packb(POSITION | {"arms": [ARM | {"x_um": deep}]}))


def pairs(*more: tuple[object, object]) -> bytes:
    """Return a position with more pairs of key and value."""
    items = [*POSITION.items(), *more]
    return bytes([0x80 | len(items)]) + b"".join(packb(part) for pair in items for part in pair)


@pytest.mark.parametrize("field", POSITION)
def test_a_duplicate_field_is_refused_by_name(field: str) -> None:
    with pytest.raises(CodecError, match=f"Position: fields twice: {field}"):
        decode(Position, pairs((field, POSITION[field])))


def test_a_duplicate_field_is_found_in_every_form_of_a_map() -> None:
    body = pairs()[1:]
    twice = body + packb("t_s") + packb(9.0)
    for head in (b"\xde\x00", b"\xdf\x00\x00\x00"):
        assert decode(Position, head + b"\x04" + body).arms[0].x_um == 12.5
        with pytest.raises(CodecError, match="fields twice: t_s"):
            decode(Position, head + b"\x05" + twice)


def test_a_duplicate_field_is_found_in_nested_maps() -> None:
    inner = packb("segments") + b"\x90"
    payload = b"\x81" + packb("program") + b"\x82" + inner + inner
    with pytest.raises(CodecError, match="Load: fields twice: segments"):
        decode(Load, payload)


@pytest.mark.parametrize("key", [b"seq", b"x" * 99, 5, 1.5, None, True])
def test_a_key_that_is_not_text_is_refused(key: object) -> None:
    with pytest.raises(CodecError, match="Position: "):
        decode(Position, pairs((key, 1)))


@pytest.mark.parametrize("key", ["\x1b[2J\x07", "a\nb", "x" * 300, "\u202ehidden"])
def test_an_unknown_field_cannot_inject_text_into_a_log(key: str) -> None:
    with pytest.raises(CodecError) as caught:
        decode(Position, pairs((key, 1)))
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 120


def test_many_unknown_fields_are_counted() -> None:
    tree = POSITION | {f"field_{number:02}": 1 for number in range(30)}
    with pytest.raises(CodecError, match=r"field_00, .*, field_04 and 25 more$"):
        decode(Position, packb(tree))


def test_invalid_text_is_refused() -> None:
    for text in (b"\xa2\xff\xfe", b"\xa3\xed\xa0\x80", b"\xa2\xc3\x28"):
        payload = packb(POSITION).replace(packb("fault") + b"\xc0", packb("fault") + text)
        with pytest.raises(CodecError, match="Position: not MessagePack"):
            decode(Position, payload)


def test_a_value_that_is_not_a_map_is_refused() -> None:
    for tree in (None, 1, "a", [], [1.0], True):
        for kind in (Command, StatusRequest):
            with pytest.raises(CodecError, match="not a map"):
                decode(kind, packb(tree))
    with pytest.raises(CodecError, match="unknown: a"):
        decode(StatusRequest, packb({"a": 1}))
    assert decode(StatusRequest, packb({})) == StatusRequest()
