"""One contract for every bus: in memory, and over Zenoh through a router."""

import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from time import monotonic, sleep
from typing import Any, ClassVar, cast

import pytest
import zenoh
from msgspec.structs import replace

from pincette.bus.endpoints import program_endpoint, router_endpoint
from pincette.bus.memory import MemoryBus
from pincette.bus.protocol import BusError, LatestBus, RefusalError
from pincette.bus.session import AskRouter, open_session, serve_router
from pincette.bus.topology import SessionConfig, client_session, router_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.core.codec import encode
from pincette.core.codec.wire import ENCODING
from pincette.core.faults import Cause
from pincette.core.messages import Ack, Burst, Message, Position, StatusRequest, Trip
from pincette.core.messages.arms import ArmPosition
from pincette.core.topics import BURST, JOB, POSITION, STATUS, TRIP, Request, Topic, key
from pincette.engine.rig_file import read_rig_reply, serve_rig_file
from pincette_supervisor.rigs.latch import OtherRigs
from tests.support.arms import with_arm
from tests.support.rigs import demo_rig, free_ports

WAIT_S = 5.0
ANSWER_S = 0.5 * WAIT_S
"""Longest time until a reply to a request that is given up after ``WAIT_S``."""
SAMPLE = Position(3, 0, 0.0, (ArmPosition(1.25, valid=True),))
ACQUIRED = Burst(3, 0, 1000.0, (1.0, 2.0), (0.1, 0.2), valid=True)


class BusContract:
    """Guarantees on which a program may rely; each bus provides two endpoints and a function that
    lets messages pass."""

    places: ClassVar[tuple[str, ...]] = ("one", "two")

    @pytest.fixture
    def buses(self) -> Iterator[tuple[LatestBus, LatestBus]]:
        raise NotImplementedError

    def settle(self, buses: tuple[LatestBus, LatestBus], done: Callable[[], bool]) -> None:
        raise NotImplementedError

    def test_messages_arrive_complete_and_in_order(
        self, buses: tuple[LatestBus, LatestBus]
    ) -> None:
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

    def test_a_query_is_answered(self, buses: tuple[LatestBus, LatestBus]) -> None:
        requests: list[Message] = []

        def answer(
            _question: Request, request: Message, reply: Callable[[Message | str], None]
        ) -> None:
            requests.append(request)
            reply(Ack(41))

        buses[1].serve(TRIP, answer)
        self.settle(buses, lambda: True)
        assert buses[0].call(TRIP, Trip(Cause.ESTOP)) == Ack(41)
        assert requests == [Trip(Cause.ESTOP)]

    def test_a_refusal_states_its_reason(self, buses: tuple[LatestBus, LatestBus]) -> None:
        def refuse(
            _question: Request, _request: Message, reply: Callable[[Message | str], None]
        ) -> None:
            reply("latched: estop")

        buses[1].serve(TRIP, refuse)
        self.settle(buses, lambda: True)
        with pytest.raises(RefusalError, match="latched: estop"):
            buses[0].call(TRIP, Trip(Cause.ESTOP))

    def test_a_missing_program_is_an_error_that_names_it(
        self, buses: tuple[LatestBus, LatestBus]
    ) -> None:
        with pytest.raises(BusError, match="estimator/status"):
            buses[0].call(STATUS["estimator"], StatusRequest(), 0.3)

    def test_a_missing_reply_is_an_error_after_the_timeout(
        self, buses: tuple[LatestBus, LatestBus]
    ) -> None:
        kept: list[Callable[[Message | str], None]] = []

        def silent(
            _question: Request, _request: Message, reply: Callable[[Message | str], None]
        ) -> None:
            kept.append(reply)

        buses[1].serve(TRIP, silent)
        self.settle(buses, lambda: True)
        with pytest.raises(BusError, match="actuator/trip"):
            buses[0].call(TRIP, Trip(Cause.ESTOP), 0.3)

    def test_the_newest_message_of_a_topic_can_be_queried(
        self, buses: tuple[LatestBus, LatestBus]
    ) -> None:
        for seq in range(3):
            buses[0].publish(replace(SAMPLE, seq=seq))
        self.settle(buses, lambda: True)
        assert buses[1].latest(POSITION) == replace(SAMPLE, seq=2)
        buses[0].publish(replace(SAMPLE, epoch=4))
        assert buses[1].latest(POSITION) == replace(SAMPLE, epoch=4)

    def test_before_the_first_message_a_query_returns_nothing(
        self, buses: tuple[LatestBus, LatestBus]
    ) -> None:
        buses[0].publish(SAMPLE)
        self.settle(buses, lambda: True)
        assert buses[1].latest(JOB) is None


class TestMemoryBus(BusContract):
    @pytest.fixture
    def buses(self) -> Iterator[tuple[LatestBus, LatestBus]]:
        bus = MemoryBus()
        yield bus, bus
        bus.close()

    def settle(self, buses: tuple[LatestBus, LatestBus], done: Callable[[], bool]) -> None:
        bus = buses[0]
        assert isinstance(bus, MemoryBus)
        while bus.pump():
            pass
        assert done()


class TestZenohBus(BusContract):
    @pytest.fixture
    def ends(self) -> Generator[SessionConfig]:
        """Connect a tool to its own router."""
        port = free_ports(1)
        end, up = threading.Event(), threading.Event()

        def wait(_ask: AskRouter) -> None:
            up.set()
            end.wait()

        router = threading.Thread(
            target=serve_router, args=(router_session("127.0.0.1", port), "contract", wait)
        )
        router.start()
        assert up.wait(WAIT_S)
        yield client_session("127.0.0.1", port)
        end.set()
        router.join()

    @pytest.fixture
    def buses(self, ends: SessionConfig) -> Generator[tuple[LatestBus, LatestBus]]:
        with ExitStack() as stack:
            pair = [ZenohBus(ends, "contract", place) for place in self.places]
            for bus in pair:
                stack.callback(bus.close)
            yield pair[0], pair[1]

    @pytest.fixture
    def in_real_time(self, ends: SessionConfig) -> Generator[ZenohBus]:
        bus = ZenohBus(ends, "contract", "one")
        yield bus
        bus.close()

    @pytest.fixture
    def session(self, ends: SessionConfig) -> Generator[zenoh.Session]:
        """A tool that knows nothing of this bus."""
        with open_session(ends, "tool") as session:
            yield session

    def settle(self, buses: tuple[LatestBus, LatestBus], done: Callable[[], bool]) -> None:
        """Wait for declarations and messages, which take a moment between processes."""
        first, second = buses
        assert isinstance(first, ZenohBus)
        assert isinstance(second, ZenohBus)
        second.announce("settled")
        deadline = monotonic() + WAIT_S
        while not (done() and "settled" in first.alive()):
            assert monotonic() < deadline
            sleep(0.005)

    def test_a_topic_without_messages_returns_nothing(
        self, buses: tuple[LatestBus, LatestBus]
    ) -> None:
        first, second = buses
        assert isinstance(first, ZenohBus)
        first.declare(POSITION)
        self.settle(buses, lambda: True)
        begun = monotonic()
        assert second.latest(POSITION, WAIT_S) is None
        assert monotonic() - begun < ANSWER_S, (
            "the query must get an empty reply and not run into its timeout"
        )

    def test_any_tool_can_query_one_or_all_topics(
        self, buses: tuple[LatestBus, LatestBus], session: zenoh.Session
    ) -> None:
        for message in (SAMPLE, ACQUIRED):
            buses[0].publish(message)
        self.settle(buses, lambda: True)
        replies = {
            str(reply.ok.key_expr): (reply.ok.payload.to_bytes(), str(reply.ok.encoding))
            for reply in cast(Any, session.get("pincette/v2/contract/*", timeout=WAIT_S))
        }
        assert replies == {
            key("contract", POSITION): (encode(SAMPLE), ENCODING),
            key("contract", BURST): (encode(ACQUIRED), ENCODING),
        }

    def test_no_message_blocks_its_sender_in_real_time(
        self, in_real_time: ZenohBus, session: zenoh.Session
    ) -> None:
        heard: dict[str, tuple[Any, Any]] = {}

        def hear(sample: zenoh.Sample) -> None:
            heard[str(sample.key_expr)] = (sample.congestion_control, sample.priority)

        session.declare_subscriber("pincette/v2/contract/*", hear)
        deadline = monotonic() + WAIT_S
        while len(heard) < 2:
            assert monotonic() < deadline
            in_real_time.publish(SAMPLE)
            in_real_time.publish(ACQUIRED)
            sleep(0.01)
        drop = zenoh.CongestionControl.DROP
        assert heard == {
            key("contract", POSITION): (drop, zenoh.Priority.REAL_TIME),
            key("contract", BURST): (drop, zenoh.Priority.INTERACTIVE_HIGH),
        }

    def test_an_invalid_message_is_counted_and_dropped(
        self, buses: tuple[LatestBus, LatestBus]
    ) -> None:
        first, second = buses
        assert isinstance(second, ZenohBus)
        got: list[Message] = []
        second.subscribe(POSITION, lambda _topic, message: got.append(message))
        self.settle(buses, lambda: True)
        first.publish(with_arm(SAMPLE, x_um=float("nan")))
        first.publish(SAMPLE)
        self.settle(buses, lambda: bool(got))
        assert got == [SAMPLE]
        assert second.refused.count == 1
        assert "x_um" in second.refused.reason

    def test_programs_of_every_rig_are_found_and_report_their_rig_file(
        self, ends: SessionConfig, buses: tuple[LatestBus, LatestBus]
    ) -> None:
        watcher, file = buses[0], demo_rig()
        assert isinstance(watcher, ZenohBus)
        turns: list[tuple[str, str, bool]] = []
        watcher.watch_everywhere(lambda rig, program, alive: turns.append((rig, program, alive)))
        program = ZenohBus(ends, "other", "sensor")
        serve_rig_file(program, file, "sensor")
        program.announce("sensor")
        self.settle(buses, lambda: ("other", "sensor", True) in turns)
        expected = {("other", "sensor"), ("contract", "settled")}
        self.settle(buses, lambda: expected <= watcher.alive_everywhere())
        assert "sensor" not in watcher.alive()
        others = OtherRigs(lambda: ZenohBus(ends, "contract", "asker"))
        assert read_rig_reply(others.rig_file("other", "sensor")) == file
        with pytest.raises(BusError, match="other: no program answers actuator/rig_file"):
            others.rig_file("other", "actuator")
        others.close()
        program.close()
        self.settle(buses, lambda: ("other", "sensor", False) in turns)


def test_a_simulated_rig_waits_for_a_router_that_starts_late() -> None:
    """Both are started together, and on a busy machine the router takes longer."""
    rig = demo_rig()
    with ThreadPoolExecutor(1) as pool:
        joining = pool.submit(
            open_session, program_endpoint(rig, "rig", lockstep=False), "demo/rig"
        )
        sleep(3.5)  # other programs are given 3 s
        assert not joining.done()
        with open_session(router_endpoint(rig), "router"), joining.result(20.0) as session:
            assert session.info.routers_zid()
