"""Messages of another wire version are not received, but their programs are seen and named."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import threading
from collections.abc import Generator
from typing import cast

import pytest
import zenoh

from pincette.bus.protocol import BusError
from pincette.bus.session import open_session
from pincette.bus.topology import SessionConfig
from pincette.bus.zenoh_bus import ZenohBus
from pincette.core.codec import encode
from pincette.core.codec.wire import ENCODING
from pincette.core.messages import Ack, Position, StatusRequest
from pincette.core.messages.arms import ArmPosition
from pincette.core.topics import POSITION, STATUS, live_key, request_key
from pincette.engine.peers import wait_for_peers
from pincette.engine.process import loop_services
from tests.support.rigs import demo_rig
from tests.support.routed import router, until

OLDER, NEWER = (ENCODING.replace("v2", version) for version in ("v1", "v3"))
SAMPLE = Position(3, 0, 0.0, (ArmPosition(1.25, valid=True),))


@pytest.fixture
def both() -> Generator[tuple[ZenohBus, zenoh.Session]]:
    """Start a program of this version, and a session of any version."""
    with router("demo") as ends, open_session(ends, "other") as other:
        bus = ZenohBus(ends, "demo", "tool")
        yield bus, other
        bus.close()


def test_a_program_of_another_version_is_found(both: tuple[ZenohBus, zenoh.Session]) -> None:
    bus, other = both
    assert bus.other_wires() == {}
    keys = (live_key("demo", "sensor"), "pincette/v3/demo/live/controller", "pincette/v0/demo/x")
    tokens = [other.liveliness().declare_token(place) for place in keys]
    until(lambda: bus.alive() == {"sensor"} and bus.other_wires() == {"controller": 3})
    assert tokens


@pytest.mark.parametrize(
    ("wire", "words"),
    [
        (3, "controller runs with wire version 3, this program has 2: update this program"),
        (1, "controller runs with wire version 1, this program has 2: update the controller"),
    ],
)
def test_a_request_to_another_version_states_which_side_to_update(
    both: tuple[ZenohBus, zenoh.Session], wire: int, words: str
) -> None:
    bus, other = both
    with pytest.raises(BusError, match="is it running"):
        bus.call(STATUS["controller"], StatusRequest(), 0.3)
    token = other.liveliness().declare_token(f"pincette/v{wire}/demo/live/controller")
    until(lambda: bool(bus.other_wires()))
    with pytest.raises(BusError) as caught:
        bus.call(STATUS["controller"], StatusRequest(), 0.3)
    assert str(caught.value).endswith(words)
    assert token


def test_a_reply_of_another_version_states_which_side_to_update(
    both: tuple[ZenohBus, zenoh.Session],
) -> None:
    bus, other = both

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(
                query.key_expr,
                encode(Ack(1)),
                encoding=zenoh.Encoding(NEWER),
                attachment=query.attachment,
            )

    served = other.declare_queryable(request_key("demo", STATUS["controller"]), answer)
    said = ""

    def told() -> bool:
        nonlocal said
        with pytest.raises(BusError) as caught:
            bus.call(STATUS["controller"], StatusRequest(), 0.3)
        said = str(caught.value)
        return "is it running" not in said

    until(told)
    assert "controller/status: Status: fields missing or unknown" in said
    assert said.endswith("wire version 3, this program has 2: update this program")
    assert served


def test_a_sample_of_another_version_is_counted_with_the_side_to_update(
    both: tuple[ZenohBus, zenoh.Session],
) -> None:
    bus, other = both
    bus.subscribe(POSITION, lambda _topic, _message: None)
    payload = encode(SAMPLE).replace(b"valid", b"sound")

    def told(encoding: str, words: str) -> None:
        def heard() -> bool:
            other.put("pincette/v2/demo/position", payload, encoding=zenoh.Encoding(encoding))
            return words in bus.refused.reason

        until(heard)

    told(OLDER, "sensor runs with wire version 1, this program has 2: update the sensor")
    told(ENCODING, "start all programs with the same version of pincette")
    told("zenoh/bytes", "it was not sent by sensor")


def test_waiting_for_a_program_reports_that_it_has_another_version(
    caplog: pytest.LogCaptureFixture,
) -> None:
    stop = threading.Event()

    class Alone:
        """Waiting ends although one of the partners has another version."""

        def __init__(self) -> None:
            self.there = [{"estimator"}, {"estimator"}, {"estimator", "actuator"}]

        def alive(self) -> set[str]:
            return self.there.pop(0)

        def other_wires(self) -> dict[str, int]:
            return {"actuator": 3}

    with caplog.at_level("INFO", "pincette"):
        bus = cast(ZenohBus, Alone())
        assert wait_for_peers(
            "sensor", demo_rig(), bus, SessionConfig("peer"), loop_services(), stop
        )
    assert caplog.messages == [
        "waiting for actuator (actuator runs with wire version 3, this program has 2: "
        "update this program)"
    ]
