"""Faults of a message between two programs, as data."""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import msgpack as untyped_msgpack

msgpack = cast(Any, untyped_msgpack)
Link = tuple[str, str]
"""Sender and receiver."""
Befalls = Literal["lost", "late", "twice", "corrupt", "unreadable"]


@dataclass(frozen=True, slots=True)
class LinkFault:
    """A fault of the messages of a link, within an interval of time.

    ``lost``       the message does not arrive.
    ``late``       the message arrives ``late_s`` later, and may be overtaken.
    ``twice``      the message arrives, and a copy ``late_s`` later.
    ``corrupt``    the message arrives with another ``value`` in its field ``field``.
    ``unreadable`` only half of the message arrives.
    """

    befalls: Befalls
    source: str = "*"
    to: str = "*"
    begin_s: float = 0.0
    end_s: float = float("inf")
    late_s: float = 0.0
    share: float = 1.0
    field: str = ""
    value: Any = None

    def hits(self, link: Link, now_s: float, chance: random.Random) -> bool:
        """True if the fault affects a message that is sent now."""
        return (
            self.source in ("*", link[0])
            and self.to in ("*", link[1])
            and self.begin_s <= now_s < self.end_s
            and (self.share >= 1.0 or chance.random() < self.share)
        )


def on_the_way(
    faults: Sequence[LinkFault],
    link: Link,
    payload: bytes,
    now_s: float,
    chance: random.Random,
) -> list[tuple[float, bytes]]:
    """Return the copies of a message that arrive: the added delay and the bytes of each."""
    arriving = [(0.0, payload)]
    for fault in faults:
        if not fault.hits(link, now_s, chance):
            continue
        match fault.befalls:
            case "lost":
                return []
            case "late":
                arriving = [(late_s + fault.late_s, data) for late_s, data in arriving]
            case "twice":
                arriving += [(late_s + fault.late_s, data) for late_s, data in arriving]
            case "corrupt":
                arriving = [
                    (late_s, corrupted(data, fault.field, fault.value)) for late_s, data in arriving
                ]
            case "unreadable":
                arriving = [(late_s, data[: len(data) // 2]) for late_s, data in arriving]
    return arriving


def corrupted(payload: bytes, field: str, value: Any) -> bytes:
    """Return the same map with another value in one field, of its own or of its first arm."""
    tree = msgpack.unpackb(payload)
    arm = tree.get("arms", [{}])[0]
    if field in tree:
        tree[field] = value
    elif field in arm:
        arm[field] = value
    return cast(bytes, msgpack.packb(tree))
