"""One contract for every bus: in memory, and over Zenoh through a router."""

import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from dataclasses import replace
from time import monotonic, sleep
from typing import ClassVar

import pytest

from pincette.bus.links import client_ends, router_ends
from pincette.bus.memory import MemoryBus
from pincette.bus.protocol import Bus, BusError, RefusalError
from pincette.bus.zenoh_bus import ZenohBus, serve_router
from pincette.messages import Done, Message, Position, StatusRequest, Trip
from pincette.topics import POSITION, STATUS, TRIP, Question, Topic
from tests.support.rigs import free_ports

WAIT_S = 5.0
SAMPLE = Position(3, 0, 0.0, 1.25, True)


class BusContract:
    """What a program may rely on; each bus brings two places and a way to let messages pass."""

    places: ClassVar[tuple[str, ...]] = ("one", "two")

    @pytest.fixture
    def buses(self) -> Iterator[tuple[Bus, Bus]]:
        raise NotImplementedError

    def settle(self, buses: tuple[Bus, Bus], done: Callable[[], bool]) -> None:
        raise NotImplementedError

    def test_messages_arrive_in_order_and_whole(self, buses: tuple[Bus, Bus]) -> None:
        got: list[Message] = []

        def take(topic: Topic, message: Message) -> None:
            assert topic is POSITION
            got.append(message)

        buses[1].subscribe(POSITION, take)
        self.settle(buses, lambda: True)
        sent = [replace(SAMPLE, seq=seq) for seq in range(50)]
        for message in sent:
            buses[0].publish(message)
        self.settle(buses, lambda: len(got) == len(sent))
        assert got == sent

    def test_a_question_is_answered(self, buses: tuple[Bus, Bus]) -> None:
        asked: list[Message] = []

        def answer(
            _question: Question, request: Message, reply: Callable[[Message | str], None]
        ) -> None:
            asked.append(request)
            reply(Done(41))

        buses[1].serve(TRIP, answer)
        self.settle(buses, lambda: True)
        assert buses[0].ask(TRIP, Trip("estop")) == Done(41)
        assert asked == [Trip("estop")]

    def test_a_refusal_brings_its_reason(self, buses: tuple[Bus, Bus]) -> None:
        def refuse(
            _question: Question, _request: Message, reply: Callable[[Message | str], None]
        ) -> None:
            reply("latched: estop")

        buses[1].serve(TRIP, refuse)
        self.settle(buses, lambda: True)
        with pytest.raises(RefusalError, match="latched: estop"):
            buses[0].ask(TRIP, Trip("estop"))

    def test_nobody_there_is_an_error_that_says_who(self, buses: tuple[Bus, Bus]) -> None:
        with pytest.raises(BusError, match="estimator/status"):
            buses[0].ask(STATUS["estimator"], StatusRequest(), 0.3)

    def test_silence_is_an_error_after_the_time_that_was_given(
        self, buses: tuple[Bus, Bus]
    ) -> None:
        kept: list[Callable[[Message | str], None]] = []

        def silent(
            _question: Question, _request: Message, reply: Callable[[Message | str], None]
        ) -> None:
            kept.append(reply)

        buses[1].serve(TRIP, silent)
        self.settle(buses, lambda: True)
        with pytest.raises(BusError, match="actuator/trip"):
            buses[0].ask(TRIP, Trip("estop"), 0.3)


class TestMemoryBus(BusContract):
    @pytest.fixture
    def buses(self) -> Iterator[tuple[Bus, Bus]]:
        bus = MemoryBus()
        yield bus, bus
        bus.close()

    def settle(self, buses: tuple[Bus, Bus], done: Callable[[], bool]) -> None:
        bus = buses[0]
        assert isinstance(bus, MemoryBus)
        while bus.pump():
            pass
        assert done()


class TestZenohBus(BusContract):
    @pytest.fixture
    def buses(self) -> Generator[tuple[Bus, Bus]]:
        port = free_ports(1)
        end, up = threading.Event(), threading.Event()

        def wait() -> None:
            up.set()
            end.wait()

        router = threading.Thread(
            target=serve_router, args=(router_ends("127.0.0.1", port), "contract", wait)
        )
        router.start()
        assert up.wait(WAIT_S)
        with ExitStack() as stack:
            stack.callback(router.join)
            stack.callback(end.set)
            ends = client_ends("127.0.0.1", port)
            pair = [ZenohBus(ends, "contract", place, reliable=True) for place in self.places]
            for bus in pair:
                stack.callback(bus.close)
            yield pair[0], pair[1]

    def settle(self, buses: tuple[Bus, Bus], done: Callable[[], bool]) -> None:
        """Declarations and messages need a moment between processes; both are polled for."""
        first, second = buses
        assert isinstance(first, ZenohBus)
        assert isinstance(second, ZenohBus)
        second.announce("settled")
        deadline = monotonic() + WAIT_S
        while not (done() and "settled" in first.alive()):
            assert monotonic() < deadline
            sleep(0.005)

    def test_what_is_no_message_is_counted_and_goes_no_further(
        self, buses: tuple[Bus, Bus]
    ) -> None:
        first, second = buses
        assert isinstance(second, ZenohBus)
        got: list[Message] = []
        second.subscribe(POSITION, lambda _topic, message: got.append(message))
        self.settle(buses, lambda: True)
        first.publish(replace(SAMPLE, x_um=float("nan")))
        first.publish(SAMPLE)
        self.settle(buses, lambda: bool(got))
        assert got == [SAMPLE]
        assert second.refused == 1
        assert "x_um" in second.refusal
