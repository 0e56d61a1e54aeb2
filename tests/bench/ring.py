"""One do-nothing process of the bare ring: the loop's hops, settings and payloads, no work.

    python -m tests.bench.ring ROLE URL PORT [routed | whole]

Roles have the names of the services. The sensor begins a tick with a serial exchange, the
actuator ends it with one; each hands on a payload of the size that its service sends. In a whole
one each also takes what else its service takes, and drops it.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import os
import signal
import sys
import threading
from queue import SimpleQueue

import zenoh

from pincette.bus.zenoh_bus import open_session
from pincette.instruments.link import open_link
from pincette.topics import LOOP
from tests.bench.shape import REQUESTS, SIZES, ends, heard, hop_key, routed_ends, start_key

DROPPED = 2
"""What is taken and has no further use."""


def main(role: str, url: str, port: int, kind: str = "") -> None:
    """Hand on until standard input closes."""
    whole = kind == "whole"
    place = routed_ends(port) if kind == "routed" else ends(port, role, whole=whole)
    session = open_session(place, role)
    link = open_link(url, baud=115200, timeout_s=5.0) if role in REQUESTS else None
    queue: SimpleQueue[int] = SimpleQueue()
    payload = bytes(SIZES[role])
    publisher = session.declare_publisher(
        hop_key(role),
        congestion_control=zenoh.CongestionControl.BLOCK,
        priority=zenoh.Priority.REAL_TIME,
    )
    before = LOOP[LOOP.index(role) - 1]
    left = 0

    def hop(sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()
        queue.put(1)

    def begin(sample: zenoh.Sample) -> None:
        queue.put(-int(sample.payload.to_bytes()))

    def drop(sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()
        queue.put(DROPPED)

    keep = [
        session.declare_subscriber(hop_key(other), hop if other == before else drop)
        for other in heard(role, whole=whole)
    ]
    if role == "sensor":
        keep.append(session.declare_subscriber(start_key(), begin))
    threading.Thread(target=_leash, args=(queue,), daemon=True).start()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    while (item := queue.get()) != 0:
        if item == DROPPED:
            continue
        left = -item if item < 0 else left
        if role == "sensor":
            left -= 1
            if left < 0:
                continue
        if link is not None:
            link.exchange(REQUESTS[role])
        publisher.put(payload)
    session.close()


def _leash(queue: "SimpleQueue[int]") -> None:
    os.read(0, 1)
    queue.put(0)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), *sys.argv[4:])
