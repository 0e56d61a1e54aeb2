"""No message waits for a link that accepts no data, whatever quality of service its sender chose.

The limits after which Zenoh or the project closes a stalled link are much longer here than in use,
so that a thread which waits for such a link can be distinguished from a busy machine.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
import socket
import threading
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import partial
from time import monotonic, sleep

import pytest
import zenoh

from pincette.bus import settings as bus_settings
from pincette.bus.protocol import BusError
from pincette.bus.topology import address_of, client_session, direct_session, peer_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.control.quantities import Document
from pincette.core.codec import encode
from pincette.core.faults import ActionCode, Cause
from pincette.core.messages import (
    Ack,
    Action,
    JobNotice,
    Lease,
    Message,
    RigFileReply,
    RigFileRequest,
    Trip,
)
from pincette.core.topics import ACTION, JOB, LEASE, RIG_FILE, TRIP, Request, request_key
from pincette.engine.process import loop_services
from tests.support.doors import Door
from tests.support.rigs import free_ports
from tests.support.routed import until

STALL_S = 20.0
"""Time for which a link may stall here before it is closed, in s; 0.2 and 0.5 in use."""
LONGEST_S = STALL_S / 4
"""Longest time of a call that must not wait, on a busy machine; one that waits takes STALL_S."""
LOUD = 4
"""Number of senders; Zenoh receives in two threads for each process."""
CHUNK = "x" * 60_000
FULL_BYTES = 8_000_000
"""Number of bytes that exceeds all buffers of a link and the queue of one priority."""
NOTICE = JobNotice("j" * 300, "grip", 1, "running", "hold", "c" * 300, held=True, at="t" * 300)
QUICK_S = 0.3
"""Deadline of the requests."""
BLOCK = zenoh.CongestionControl.BLOCK


@pytest.fixture(autouse=True)
def _long_stalls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_settings, "BLOCK_US", round(1e6 * STALL_S))
    monkeypatch.setattr(bus_settings, "LEASE_MS", round(1e3 * STALL_S))


@contextmanager
def stall(port: int, *, both_ways: bool = False) -> Generator[tuple[int, threading.Event]]:
    """Forward connections to a port; while the event is set, nothing that the port sends is read.

    ``both_ways``: nothing is sent to the port either.
    """
    stalled, lines = threading.Event(), list[socket.socket]()

    def carry(source: socket.socket, target: socket.socket, *, waits: bool) -> None:
        with suppress(OSError):
            while found := source.recv(65536):
                while waits and stalled.is_set():
                    sleep(0.01)
                target.sendall(found)
        for line in (source, target):
            line.close()

    with socket.create_server(("127.0.0.1", 0)) as listener:

        def accept() -> None:
            while True:
                try:
                    near, _ = listener.accept()
                except OSError:
                    return
                far = socket.create_connection(("127.0.0.1", port))
                lines.extend((near, far))
                for source, target, waits in ((near, far, both_ways), (far, near, True)):
                    threading.Thread(
                        target=carry, args=(source, target), kwargs={"waits": waits}, daemon=True
                    ).start()

        threading.Thread(target=accept, daemon=True).start()
        yield listener.getsockname()[1], stalled
        stalled.clear()
        listener.shutdown(socket.SHUT_RDWR)
        for line in lines:
            with suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)


@contextmanager
def foreign_client(port: int) -> Generator[zenoh.Session]:
    """Open a session with Zenoh's own settings."""
    tree = {
        "mode": "client",
        "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        "scouting": {"multicast": {"enabled": False}},
    }
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(tree)))
    try:
        yield session
    finally:
        session.close()


def acknowledge(_: Request, _request: Message, reply: Callable[[Message | str], None]) -> None:
    reply(Ack(1))


def longest(calls: int, call: Callable[[], object]) -> float:
    """Return the longest time that a call took, in s."""
    longest_s = 0.0
    for _ in range(calls):
        begun_s = monotonic()
        with suppress(BusError):
            call()
        longest_s = max(longest_s, monotonic() - begun_s)
    return longest_s


@pytest.mark.parametrize("refused", [False, True], ids=["replies", "refusals"])
def test_a_loop_program_does_not_wait_for_a_client_that_reads_no_reply(refused: bool) -> None:
    """By default a query of any Zenoh tool requests a reply that blocks."""
    port, took_s, sent = free_ports(8), list[float](), 0
    place = peer_session("127.0.0.1", port, "actuator", loop_services(), lockstep=False)

    def answer(_: Request, _request: Message, reply: Callable[[Message | str], None]) -> None:
        nonlocal sent
        begun_s = monotonic()
        reply(CHUNK if refused else RigFileReply(Document(CHUNK), ""))
        took_s.append(monotonic() - begun_s)
        sent += len(CHUNK)

    with ExitStack() as stack:
        actuator = stack.enter_context(closing(ZenohBus(place, "demo", "actuator")))
        actuator.serve(RIG_FILE["actuator"], answer)
        actuator.serve(TRIP, acknowledge)
        at = direct_session("127.0.0.1", port, "actuator")
        near, stalled = stack.enter_context(stall(address_of(at.connect[0])[1]))
        client = stack.enter_context(foreign_client(near))
        person = stack.enter_context(closing(ZenohBus(at, "demo", "estop")))
        question, body = request_key("demo", RIG_FILE["actuator"]), encode(RigFileRequest())
        stalled.set()
        begun_s = monotonic()
        while sent < FULL_BYTES:
            client.get(question, lambda _: None, payload=body, congestion_control=BLOCK)
            sleep(0.001)
            assert monotonic() - begun_s < STALL_S
        assert person.call(TRIP, Trip(Cause.ESTOP)) == Ack(1)
        assert monotonic() - begun_s < STALL_S
        stalled.clear()
    assert max(took_s) < LONGEST_S


def test_a_supervisor_does_not_wait_for_a_router_that_reads_nothing() -> None:
    door = Door(None)
    with ExitStack() as stack:
        stack.callback(door.router.close)
        near, stalled = stack.enter_context(stall(door.port, both_ways=True))
        config = client_session("127.0.0.1", near)
        bus = stack.enter_context(closing(ZenohBus(config, "demo", "supervisor")))
        tool = stack.enter_context(closing(ZenohBus(door.client, "demo", "tool")))
        heard = list[Message]()
        tool.subscribe(JOB, lambda _, message: heard.append(message))
        until(lambda: bool(bus.publish(NOTICE)) or bool(heard))
        stalled.set()
        notices = FULL_BYTES // len(encode(NOTICE))
        assert longest(notices, lambda: bus.publish(NOTICE)) < LONGEST_S
        requests: list[tuple[Request, Message]] = [
            (ACTION, Action(ActionCode.STOP)),
            (LEASE, Lease(1, 1.0)),
            (TRIP, Trip(Cause.ESTOP)),
        ]
        for question, request in requests:
            took_s = longest(3, partial(bus.call, question, request, QUICK_S))
            assert took_s < QUICK_S + LONGEST_S, question.name
        stalled.clear()


def test_a_router_continues_despite_a_tool_that_reads_nothing() -> None:
    """Both tools are foreign, and the sender requests that its messages block."""
    door = Door(None)
    with ExitStack() as stack:
        stack.callback(door.router.close)
        near, stalled = stack.enter_context(stall(door.port))
        deaf = stack.enter_context(foreign_client(near))
        deaf.declare_subscriber("foreign/**", lambda _: None)
        loud = [stack.enter_context(foreign_client(door.port)) for _ in range(LOUD)]
        actuator = stack.enter_context(closing(ZenohBus(door.client, "demo", "actuator")))
        actuator.serve(TRIP, acknowledge)
        tool = stack.enter_context(closing(ZenohBus(door.client, "demo", "tool")))
        assert tool.call(TRIP, Trip(Cause.ESTOP)) == Ack(1)
        stalled.set()
        end = threading.Event()

        def shout(session: zenoh.Session) -> None:
            while not end.is_set():
                session.put("foreign/1", CHUNK, congestion_control=BLOCK)

        threads = [threading.Thread(target=shout, args=(one,)) for one in loud]
        for thread in threads:
            thread.start()
        try:
            sleep(0.5)
            for _ in range(20):
                assert tool.call(TRIP, Trip(Cause.ESTOP), LONGEST_S) == Ack(1)
        finally:
            end.set()
            stalled.clear()
            for thread in threads:
                thread.join()
