"""Transmission time over the bus from a thread of one program to that of another, over loopback."""

from queue import Empty, SimpleQueue
from time import monotonic, sleep

from pincette.bus.protocol import BusError
from pincette.bus.topology import PLAIN, SessionConfig
from pincette.bus.zenoh_bus import ZenohBus
from pincette.core.messages import Estimate, Message, Position
from pincette.core.messages.arms import ArmEstimate, ArmPosition
from pincette.core.topics import ESTIMATE, POSITION
from pincette.latency.histogram import Distribution, Histogram

HOST = "127.0.0.1"
RIG = "latency"
EVERY_S = 0.005
"""Time between two exchanges, in s, so that both sides sleep in between, as in a tick."""
MATCHED_S = 5.0
LOST_S = 1.0
"""Time after which a reply counts as lost, in s."""
SETTLED = 20
"""Number of exchanges at the beginning that are not counted."""
Messages = SimpleQueue[Message]
"""Messages from the bus, for the thread that waits for them."""


def echo(port: int, asker: int, for_s: float) -> None:
    """Reply to each position with an estimate, as the loop's second program does; raises
    BusError.
    """
    bus = ZenohBus(_ends(port, asker), RIG, "echo")
    queue: Messages = SimpleQueue()
    end_s = monotonic() + for_s
    try:
        bus.declare(ESTIMATE)
        bus.subscribe(POSITION, lambda _topic, message: queue.put(message))
        while (left_s := end_s - monotonic()) > 0.0:
            try:
                message = queue.get(timeout=left_s)
            except Empty:
                return
            if isinstance(message, Position):
                bus.publish(_estimate(message))
    finally:
        bus.close()


def hops(port: int, for_s: float) -> Distribution:
    """Exchange samples with the echo program for some time; record half of each round-trip time."""
    bus = ZenohBus(_ends(port), RIG, "asker")
    queue: Messages = SimpleQueue()
    try:
        bus.declare(POSITION)
        bus.subscribe(ESTIMATE, lambda _topic, message: queue.put(message))
        _match(bus, queue)
        for seq in range(1, SETTLED + 1):
            _exchange(bus, queue, seq)
        found, seq = Histogram(), SETTLED
        due_s = monotonic()
        end_s = due_s + for_s
        while due_s < end_s:
            sleep(max(0.0, due_s - monotonic()))
            seq += 1
            found.add(0.5 * _exchange(bus, queue, seq))
            due_s = max(due_s + EVERY_S, monotonic())
        return found.distribution()
    finally:
        bus.close()


def _match(bus: ZenohBus, queue: Messages) -> None:
    """Wait until both sides receive each other's messages."""
    end_s = monotonic() + MATCHED_S
    while monotonic() < end_s:
        bus.publish(Position(1, 0, 0.0, (ArmPosition(0.0),)))
        try:
            queue.get(timeout=0.05)
        except Empty:
            continue
        return
    raise BusError(f"the other end of a hop has not answered within {MATCHED_S:g} s")


def _exchange(bus: ZenohBus, queue: Messages, seq: int) -> float:
    """Send a sample and wait for its reply; return the duration in s."""
    began_s = monotonic()
    bus.publish(Position(1, seq, 0.0, (ArmPosition(0.0, valid=True),)))
    while True:
        try:
            message = queue.get(timeout=LOST_S)
        except Empty:
            raise BusError(f"a sample has not come back within {LOST_S:g} s") from None
        if isinstance(message, Estimate) and message.seq == seq:
            return monotonic() - began_s


def _estimate(position: Position) -> Estimate:
    return Estimate(
        epoch=position.epoch,
        seq=position.seq,
        applied_seq=position.seq - 1,
        tripped=False,
        degraded=False,
        arms=(
            ArmEstimate(
                x_um=position.arms[0].x_um,
                force_mN=0.0,
                force_uncertainty_mN=0.0,
                perturbation_mN=0.0,
                zero_age_s=None,
                zero_refusal=None,
                applied_V=0.0,
                limits_active=0,
            ),
        ),
    )


def _ends(port: int, other: int | None = None) -> SessionConfig:
    connect = () if other is None else (f"{PLAIN}{HOST}:{other}",)
    return SessionConfig("peer", (f"{PLAIN}{HOST}:{port}",), connect)
