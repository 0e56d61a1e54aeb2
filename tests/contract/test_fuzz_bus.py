"""A foreign program puts arbitrary bytes on the keys of a rig: invalid messages are counted,
rejected and dropped.

Over a real router. Seeded.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import random
from collections.abc import Callable, Generator
from typing import Any, cast

import pytest
import zenoh

from pincette.bus.session import open_session
from pincette.bus.zenoh_bus import EMPTY, ZenohBus
from pincette.core.codec import MAX_BYTES, decode, encode
from pincette.core.codec.refusals import CodecError
from pincette.core.codec.wire import ENCODING
from pincette.core.faults import Cause
from pincette.core.messages import Ack, Command, Message, Trip
from pincette.core.messages.arms import ArmCommand
from pincette.core.topics import COMMAND, TRIP, WIRE, Request, key, request_key
from tests.support.frames import spoilt
from tests.support.routed import WAIT_S, router, until

SEED = 20133
FRAMES, REQUESTS = 2_000, 300
RIG = "besieged"
OTHER_ENCODING = f"application/msgpack;pincette.v{WIRE + 1}"
LAST = Command(1, 10, 1, (ArmCommand(1.5),), False, False, False, True)
ENCODINGS = (ENCODING, "zenoh/bytes", OTHER_ENCODING, "text/plain", "x" * 200)


@pytest.fixture(scope="module")
def program() -> Generator[tuple[ZenohBus, zenoh.Session]]:
    """Start a program of the rig and a foreign session."""
    with router(RIG) as ends, open_session(ends, "stranger") as stranger:
        bus = ZenohBus(ends, RIG, "actuator")
        yield bus, stranger
        bus.close()


def is_sound(kind: type[Message], payload: bytes) -> bool:
    try:
        decode(kind, payload)
    except CodecError:
        return False
    return True


def test_garbage_on_a_topic_is_counted_and_dropped(
    program: tuple[ZenohBus, zenoh.Session], capfd: pytest.CaptureFixture[str]
) -> None:
    bus, stranger = program
    print(f"seed {SEED}")
    chance, heard, bad = random.Random(SEED), list[Message](), 0
    bus.subscribe(COMMAND, lambda _topic, message: heard.append(message))
    place = key(RIG, COMMAND)
    bus.announce("ready")
    publisher = stranger.declare_publisher(place, congestion_control=zenoh.CongestionControl.BLOCK)
    until(lambda: cast(Any, publisher.matching_status).matching)
    before = bus.refused.count
    for payload in (spoilt(chance, Command) for _ in range(FRAMES)):
        publisher.put(payload, encoding=zenoh.Encoding(chance.choice(ENCODINGS)))
        bad += not is_sound(Command, payload)
    for payload in (b"", b"\x00" * (MAX_BYTES + 1), b"\x91" * MAX_BYTES):
        publisher.put(payload)
        bad += 1
    publisher.delete()
    bad += 1
    publisher.put(encode(LAST), encoding=zenoh.Encoding(ENCODING))
    until(lambda: bool(heard) and heard[-1] == LAST, 4 * WAIT_S)
    assert bus.refused.count - before == bad
    assert len(heard) == FRAMES + 5 - bad
    assert bus.refused.reason.isprintable()
    assert capfd.readouterr().err == ""


def test_an_invalid_query_is_answered_with_the_error(
    program: tuple[ZenohBus, zenoh.Session],
) -> None:
    bus, stranger = program
    chance, requested = random.Random(SEED), list[Message]()

    def answer(
        _question: Request, request: Message, reply: Callable[[Message | str], None]
    ) -> None:
        requested.append(request)
        reply(Ack(1))

    bus.serve(TRIP, answer)
    place = request_key(RIG, TRIP)

    def put(payload: bytes | None) -> Any:
        replies = stranger.get(place, payload=payload, timeout=WAIT_S)
        return next(iter(cast(Any, replies)), None)

    until(lambda: put(encode(Trip(Cause.ESTOP))) is not None)
    for _ in range(REQUESTS):
        payload, before = spoilt(chance, Trip), len(requested)
        reply = put(payload)
        assert (reply.ok is not None) == (len(requested) > before) == is_sound(Trip, payload)
        if reply.ok is None:
            stated = reply.err.payload.to_bytes().decode()
            assert stated.startswith("Trip") if payload else stated == EMPTY
            assert stated.isprintable()
    for payload in (None, b"", b"\x91" * (MAX_BYTES + 1)):
        assert put(payload).err is not None
