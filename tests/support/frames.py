"""Frames for the bus: valid ones of every message, made from its annotations, and corrupted
ones."""

import math
import random
import struct
import types
from collections.abc import Callable
from enum import EnumType
from functools import cache
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

from msgspec import Struct, structs

from pincette.control.laws.parameters import LawSpec
from pincette.control.planning.paths import Knot, Path
from pincette.control.planning.sweep import Sweep
from pincette.control.quantities import Document
from pincette.core.codec import KINDS, encode
from pincette.core.codec.refusals import msgpack
from pincette.core.messages import Message
from pincette.latency.histogram import Distribution
from tests.support.bounds import whole_range
from tests.support.histograms import counted
from tests.support.laws import law_settings

Chance = random.Random
BY_NAME = {kind.__name__: kind for kind in sorted(KINDS, key=lambda kind: kind.__name__)}
EPOCH, OWNER = 7, 1
"""Epoch and owner of the arming to which most frames belong."""
NOT_NEGATIVE = ("duration_s", "move_s", "run_up_s", "contact_stiffness_mN_per_um")
BY_ARM = ("to_um", "sides", "courses", "arms", "voltages")
"""Tuples with one item for each arm."""
WORDS = ("", "a", "stop", "estop", "no command", "µm", "hold", "free", "part", "remove", "off")
SELF_CHECKED: dict[type, tuple[Any, ...]] = {
    Sweep: (Sweep(5.0, 400.0, 1.0, 0.05, 4000.0), Sweep(1.0, 2.0, 0.6, 1.0, 9.0, 0.1)),
    LawSpec: (law_settings().spec(), law_settings("dsmifc", delta=1e6, K_S=3.0).spec()),
    Path: (
        Path("force", "sinusoid", 12.0, 8.0, 2.0, 3),
        Path("position", "triangle", 12.0, 8.0, 2.0, 3, corner=0.1),
        Path("voltage", "waypoints", knots=(Knot(0.0, 0.0, 0.0), Knot(1.0, 2.0, 0.0))),
    ),
    Distribution: (Distribution(), counted((0.0, 1e-6, 1e-6)), counted((5e-4, 0.02, 2e9))),
}
"""Records that refuse inconsistent values, with some valid examples."""


def sound(kind: type, chance: Chance) -> Any:
    """Return a record of any kind whose fields have valid types, though not always sensible
    values."""
    if kind in SELF_CHECKED:
        return chance.choice(SELF_CHECKED[kind])
    while True:
        try:
            return kind(**{name: _value(hint, name, chance) for name, hint in _hints(kind)})
        except ValueError:  # a record that refuses its own values
            continue


@cache
def _hints(kind: type) -> tuple[tuple[str, Any], ...]:
    """Return the fields of a record, each with its annotation."""
    hints = get_type_hints(kind)
    return tuple((item.name, hints[item.name]) for item in structs.fields(kind))


def _value(hint: Any, name: str, chance: Chance) -> Any:
    if hint is float:
        value = chance.choice((0.0, -0.0, 5e-324, 0.02, 1.5, chance.uniform(-50.0, 50.0), 1e6))
        return abs(value) if name in NOT_NEGATIVE else value
    if hint is int:
        near = {"epoch": EPOCH, "owner": OWNER, "law": 0}.get(name)
        far = chance.choice((0, 1, 2, 3, chance.randrange(300), whole_range(name)[1]))
        return far if near is None or chance.random() < 0.1 else near
    if hint is bool:
        return chance.random() < 0.5
    if hint in (str, Document):
        return chance.choice(WORDS)
    if isinstance(hint, EnumType):
        return chance.choice(list(hint.__members__.values()))
    if isinstance(hint, type) and issubclass(hint, Struct):
        return sound(hint, chance)
    if get_origin(hint) in (Union, types.UnionType):
        choices = [item for item in get_args(hint) if item is not type(None)]
        found = _value(chance.choice(choices), name, chance)
        if len(choices) == len(get_args(hint)):
            return found
        return None if chance.random() < 0.6 else found
    if get_origin(hint) is Literal:
        return chance.choice(get_args(hint))
    inner = get_args(hint)[0]
    count = chance.randrange(1, 3) if name in BY_ARM else chance.randrange(4)
    return tuple(_value(inner, name, chance) for _ in range(count))


def _deep(levels: int, leaf: bytes) -> bytes:
    """Return lists nested this deep."""
    return b"\x91" * levels + leaf


BOMBS: dict[str, bytes] = {
    "empty": b"",
    "lists in lists": b"\x91" * 65_536,
    "lists in lists to the unpacker's depth": _deep(1000, b"\xc0"),
    "maps in maps": b"\x81\xa1a" * 21_000,
    "long lists in long lists": b"\xdd\x00\x00\xff\xff" * 13_000,
    "lists at their limit": b"\xdc\x10\x00" * 21_000,
    "a list of all": b"\xdd\x00\x00\xff\xf0" + b"\xc0" * 65_500,
    "a map of all": b"\xdf\x00\x00\x7f\xf0" + b"\xa0\xc0" * 32_752,
    "a list that promises": b"\xdd\xff\xff\xff\xff",
    "a map that promises": b"\xdf\xff\xff\xff\xff",
    "a text that promises": b"\xdb\xff\xff\xff\xff",
    "bytes that promise": b"\xc6\xff\xff\xff\xff",
    "a huge extension": b"\xc9\x00\x00\xff\x00\x05" + b"x" * 0xFF00,
    "a reserved byte": b"\xc1",
    "too long": b"\x00" * 65_537,
}
"""Values that are small on the wire and would be large, deep or slow in memory."""


def nasty(chance: Chance) -> Any:
    """Return a value that fits no field, or only just."""
    return chance.choice(NASTY)


NASTY: tuple[Any, ...] = (
    math.nan, math.inf, -math.inf, 1e300, -1e300, 1e309, -0.0, 5e-324, 1e16, 2**53, 2**63 - 1,
    2**64 - 1, -(2**63), -1, -2, True, None, "", "\0", "x" * 401, "x" * 40_000, "1", "nan", b"",
    b"x" * 60, [], [[]], [1.0] * 5000, {}, {"a": 1}, {b"a": 1}, msgpack.ExtType(5, b""),
    msgpack.ExtType(5, b"x" * 99), msgpack.Timestamp(1, 1), [None], ["x"], [{"t_s": 1.0}],
)  # fmt: skip


def spoilt(chance: Chance, kind: type[Message]) -> bytes:
    """Return a frame of a kind with an error in it or in its surroundings, or noise."""
    return chance.choice(SPOILERS)(chance, encode(sound(kind, chance)))


def _leaf(chance: Chance, payload: bytes) -> bytes:
    """Replace the value of one field, at any depth."""
    tree = msgpack.unpackb(payload)
    node, places = tree, _places(tree)
    while places:
        place = chance.choice(places)
        inner = _places(node[place])
        if not inner or chance.random() < 0.3:
            node[place] = nasty(chance)
            break
        node, places = node[place], inner
    return msgpack.packb(tree)


def _places(node: Any) -> list[Any]:
    if isinstance(node, dict):
        return list(cast("dict[Any, Any]", node))
    return list(range(len(cast("list[Any]", node)))) if isinstance(node, list) else []


def _fields(chance: Chance, payload: bytes) -> bytes:
    """Drop a field, add an unknown one, use a key that is not text, or duplicate a field."""
    tree: dict[Any, Any] = msgpack.unpackb(payload)
    pairs = list(tree.items())
    place = chance.randrange(len(pairs)) if pairs else 0
    match chance.randrange(5):
        case 0:
            pairs = pairs[:place] + pairs[place + 1 :]
        case 1:
            pairs.append((chance.choice(("colour", "\x1b[2J", "", "x" * 300, "é")), 1))
        case 2:
            pairs.append((chance.choice((b"seq", 5, 1.5, None, True)), 1))
        case 3:
            pairs += pairs[place : place + 1]
        case _:
            chance.shuffle(pairs)
    few = len(pairs) < 16
    head = bytes([0x80 | len(pairs)]) if few else b"\xde" + struct.pack(">H", len(pairs))
    return head + b"".join(msgpack.packb(part) for pair in pairs for part in pair)


def _bits(chance: Chance, payload: bytes) -> bytes:
    """Flip some bits."""
    changed = bytearray(payload)
    for _ in range(chance.randrange(1, 4)):
        if changed:
            changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _cut(chance: Chance, payload: bytes) -> bytes:
    return payload[: chance.randrange(len(payload) + 1)]


def _more(chance: Chance, payload: bytes) -> bytes:
    return payload + chance.randbytes(chance.randrange(1, 9))


def _spliced(chance: Chance, payload: bytes) -> bytes:
    """Drop, insert or duplicate bytes."""
    first, last = sorted(chance.randrange(len(payload) + 1) for _ in range(2))
    middle = chance.choice((b"", chance.randbytes(3), payload[first:last] * 2))
    return payload[:first] + middle + payload[last:]


def _noise(chance: Chance, _payload: bytes) -> bytes:
    return chance.randbytes(chance.randrange(200))


def _bomb(chance: Chance, payload: bytes) -> bytes:
    """Return a bomb, or one in place of a field; rarely, since it takes long."""
    if chance.random() < 0.98:
        return payload
    bomb = chance.choice(tuple(BOMBS.values()))
    return bomb if chance.random() < 0.5 else b"\x81\xa3seq" + bomb


def _whole(_chance: Chance, payload: bytes) -> bytes:
    return payload


SPOILERS: tuple[Callable[[Chance, bytes], bytes], ...] = (
    _leaf, _leaf, _leaf, _fields, _bits, _bits, _cut, _more, _spliced, _noise, _bomb, _whole,
)  # fmt: skip
