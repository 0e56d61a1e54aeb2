"""Whatever arrives over the bus, a decoder returns a valid message or raises a refusal.

Seeded; the million frames of ``make soak`` use the same code as those of every run.
"""

import random
from collections import Counter
from math import isfinite
from typing import Any, cast

import pytest
from msgspec import Struct

from pincette.control.quantities import MAX_DOCUMENT, MAX_ITEMS
from pincette.core.codec import decode, encode
from pincette.core.codec.refusals import CodecError
from tests.support.bounds import largest, whole_range
from tests.support.frames import BY_NAME, sound, spoilt

SEED = 20131
SOUND_EACH = 100


def check(value: Any, name: str = "") -> None:
    """Check that every part of a decoded message is within its bounds."""
    if isinstance(value, Struct):
        for name in value.__struct_fields__:
            check(getattr(value, name), name)
    elif isinstance(value, tuple):
        items = cast("tuple[Any, ...]", value)
        assert len(items) <= MAX_ITEMS
        for item in items:
            check(item, name)
    elif type(value) is float:
        assert isfinite(value)
        assert abs(value) <= largest(name)
    elif type(value) is int:
        least, most = whole_range(name)
        assert least <= value <= most
    else:
        nothing = value is None or type(value) is bool
        assert nothing or len(cast(str, value)) <= MAX_DOCUMENT


def fuzzed(frames: int, seed: int) -> Counter[str]:
    """Send this many frames through the decoders; returns how many each accepted, and how many were
    refused."""
    chance, kinds, reported = random.Random(seed), list(BY_NAME.values()), Counter[str]()
    for _ in range(frames):
        kind = chance.choice(kinds)
        payload = spoilt(chance, kind)
        try:
            message = decode(kind, payload)
        except CodecError as error:
            stated = str(error)
            assert stated.startswith(kind.__name__)
            assert stated.isprintable()
            assert len(stated) < 1000
            reported["refused"] += 1
            continue
        check(message)
        assert decode(kind, encode(message)) == message
        reported[kind.__name__] += 1
    return reported


@pytest.mark.parametrize("name", BY_NAME)
def test_valid_frames_are_transferred_unchanged(name: str) -> None:
    chance, kind = random.Random(SEED), BY_NAME[name]
    for _ in range(SOUND_EACH):
        message = sound(kind, chance)
        assert decode(kind, encode(message)) == message


def test_twenty_thousand_frames_are_accepted_or_refused() -> None:
    print(f"seed {SEED}")
    reported = fuzzed(20_000, SEED)
    assert set(reported) == {"refused", *BY_NAME}, (
        "frames of each type must be accepted and some refused"
    )
    assert 0.3 < reported["refused"] / reported.total() < 0.95


@pytest.mark.slow
def test_a_million_frames_are_accepted_or_refused() -> None:
    seed = random.SystemRandom().randrange(2**32)
    print(f"seed {seed}")
    reported = fuzzed(1_000_000, seed)
    print(", ".join(f"{name} {count}" for name, count in sorted(reported.items())))
    assert set(reported) == {"refused", *BY_NAME}
