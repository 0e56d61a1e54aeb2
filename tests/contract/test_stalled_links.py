"""A partner that reads nothing: its link is closed within a lease, and the others continue."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from time import monotonic, sleep

import pytest
import zenoh

from pincette.bus import zenoh_bus
from pincette.bus.protocol import BusError
from pincette.bus.session import CLOSE_S, open_session
from pincette.bus.stopping import trip_at
from pincette.bus.topology import client_session, direct_session, peer_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.core.faults import Cause
from pincette.core.messages import Ack, Message, Position, StatusRequest, Trip
from pincette.core.messages.arms import ArmPosition
from pincette.core.topics import POSITION, STATUS, TRIP, Request, Topic
from pincette.engine.process import loop_services
from pincette.security.folder import Folder
from tests.support.doors import Door
from tests.support.rigs import free_ports
from tests.support.routed import until
from tests.support.stalled_reader import KEY

ROOT = Path(__file__).parents[2]
LEASE_S = 0.5
SLACK_S = 5.0
"""Time that a busy machine may add; without the limits a stalled link lasts for ever."""
CHUNK = bytes(60_000)


@pytest.fixture(params=["plain", "secure"])
def door(request: pytest.FixtureRequest, folder: Folder) -> Generator[tuple[Door, list[str]]]:
    """Start a router; yields it and the arguments of a stalled reader that joins it."""
    secure = request.param == "secure"
    with ExitStack() as stack:
        made = Door(folder if secure else None)
        stack.callback(made.router.close)
        yield made, [str(made.port), *([str(folder.path)] if secure else [])]


@contextmanager
def stalled_reader(arguments: list[str]) -> Generator[None]:
    program = subprocess.Popen(
        [sys.executable, "-m", "tests.support.stalled_reader", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=ROOT,
    )
    try:
        assert program.stdout is not None
        assert program.stdout.readline() == b"ready\n"
        yield
    finally:
        program.kill()
        program.communicate()


def test_a_link_that_accepts_no_data_for_a_lease_is_closed(
    door: tuple[Door, list[str]], caplog: pytest.LogCaptureFixture
) -> None:
    """Its partner's keep-alives arrive all the time, and published messages may be dropped."""
    caplog.set_level("INFO", "pincette")
    router, arguments = door
    session = router.router.session
    publisher = session.declare_publisher(
        KEY, congestion_control=zenoh.CongestionControl.DROP, priority=zenoh.Priority.REAL_TIME
    )
    with stalled_reader(arguments):
        until(session.info.links, SLACK_S)
        begun_s = monotonic()
        sent = 0
        while session.info.links():
            publisher.put(CHUNK)
            sent += len(CHUNK)
            sleep(0.001)
            assert monotonic() < begun_s + LEASE_S + SLACK_S, f"{sent} bytes"
        until(lambda: any("link down" in one for one in caplog.messages), SLACK_S)


@contextmanager
def proxy(port: int) -> Generator[tuple[int, threading.Event, list[socket.socket]]]:
    """Forward connections to a port; while the event is set nothing is forwarded in either
    direction."""
    stalled, lines = threading.Event(), list[socket.socket]()
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def carry(source: socket.socket, target: socket.socket) -> None:
            try:
                while found := source.recv(65536):
                    while stalled.is_set():
                        sleep(0.01)
                    target.sendall(found)
            except OSError:
                pass
            for line in (source, target):
                line.close()

        def accept() -> None:
            while True:
                try:
                    near, _ = listener.accept()
                except OSError:
                    return
                far = socket.create_connection(("127.0.0.1", port))
                lines.extend((near, far))
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=carry, args=pair, daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        yield listener.getsockname()[1], stalled, lines
        stalled.clear()
        listener.shutdown(socket.SHUT_RDWR)
        for line in lines:
            line.close()


def test_closing_a_session_does_not_wait_for_a_stalled_link() -> None:
    door = Door(None)
    with closing(door.router), proxy(door.port) as (port, stalled, _):
        joined = open_session(client_session("127.0.0.1", port), "tool")
        until(joined.session.info.links, SLACK_S)
        stalled.set()
        begun_s = monotonic()
        joined.close()
        assert monotonic() - begun_s < CLOSE_S + SLACK_S


def test_an_abandoned_session_keeps_no_link(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its sockets are shut down, so its partner drops it although nothing is read."""
    monkeypatch.setattr(zenoh_bus, "UNANSWERED_S", 0.3)
    door = Door(None)
    with ExitStack() as stack:
        stack.callback(door.router.close)
        mute = stack.enter_context(closing(ZenohBus(door.client, "demo", "estimator")))
        kept = list[object]()
        mute.announce("estimator")
        mute.serve(STATUS["estimator"], lambda _question, _request, reply: kept.append(reply))
        port, _, lines = stack.enter_context(proxy(door.port))
        bus = ZenohBus(client_session("127.0.0.1", port), "demo", "supervisor")
        stack.callback(bus.close)
        bus.announce("supervisor")
        until(lambda: "supervisor" in mute.alive(), SLACK_S)
        (first, _) = lines
        until(lambda: _unanswered(bus) and len(lines) > 2, 20.0)
        until(lambda: first.fileno() == -1, SLACK_S)
        until(lambda: "supervisor" in mute.alive(), SLACK_S)
        until(lambda: len(door.router.session.info.links()) == 2, SLACK_S)


def _unanswered(bus: ZenohBus) -> bool:
    with pytest.raises(BusError):
        bus.call(STATUS["estimator"], StatusRequest(), 0.2)
    return True


def answer(_question: Request, _message: Message, reply: Callable[[Message], None]) -> None:
    reply(Ack(1))


def test_hanging_consumers_do_not_block_a_stop() -> None:
    """The sessions of a process share its network threads, including the session of a stop."""
    port = free_ports(8)
    never, hung = threading.Event(), threading.Semaphore(0)

    def hang(_topic: Topic, _message: Message) -> None:
        hung.release()
        never.wait()

    router = Door(None)
    with ExitStack() as stack:
        stack.callback(router.router.close)
        at_actuator = peer_session("127.0.0.1", port, "actuator", loop_services(), lockstep=False)
        actuator = stack.enter_context(closing(ZenohBus(at_actuator, "demo", "actuator")))
        actuator.serve(TRIP, answer)
        source = stack.enter_context(closing(ZenohBus(router.client, "demo", "sensor")))
        buses = [
            stack.enter_context(closing(ZenohBus(router.client, "demo", f"tool {number}")))
            for number in range(4)
        ]
        stack.callback(never.set)
        for bus in buses:
            bus.subscribe(POSITION, hang)
        sent = 0

        def publish() -> None:
            nonlocal sent
            sent += 1
            source.publish(
                Position(epoch=1, seq=sent, t_s=0.0, arms=(ArmPosition(0.0, valid=True),))
            )

        for _ in buses:
            until(lambda: publish() or hung.acquire(blocking=False), SLACK_S)
        for _ in range(2000):  # more than Zenoh queues for a callback
            publish()
            sleep(0.0005)
        begun_s = monotonic()
        ends = direct_session("127.0.0.1", port, "actuator")
        assert trip_at(ends, "demo", Trip(Cause.ESTOP)) == Ack(1)
        assert monotonic() - begun_s < 1.0 + SLACK_S
        for bus in buses:
            assert bus.alive() == set()  # which is a reply of the router
