"""One do-nothing process of the bare ring: the loop's hops, settings and payloads, no work.

Roles have the names of the services. The sensor begins a tick with a serial exchange, the
actuator ends it with one; each hands on a payload of the size that its service sends.
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
from tests.bench.shape import SIZES, ends, hop_key, start_key

REQUESTS = {"sensor": b"MS,01", "actuator": b"#010+01.000"}


def main(role: str, port: int, url: str) -> None:
    """Hand on until standard input closes."""
    session = open_session(ends(port, role), role)
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

    keep = [session.declare_subscriber(hop_key(before), hop)]
    if role == "sensor":
        keep.append(session.declare_subscriber(start_key(), begin))
    threading.Thread(target=_leash, args=(queue,), daemon=True).start()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    while (item := queue.get()) != 0:
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
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
