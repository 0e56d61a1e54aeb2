"""One idle process of the bare ring: the loop's hops, settings and payloads, without computation.

python -m tests.bench.ring ROLE URL PORT [routed | whole | coded]

Roles have the names of the services. The sensor begins a tick with a serial exchange, the actuator
ends it with one; each sends a payload of the size that its service sends. In mode ``whole`` each
process also receives and discards the other messages that its service receives; in mode ``coded``,
which includes ``whole``, it also decodes what it receives and encodes what it sends.
"""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import json
import os
import signal
import sys
import threading
from functools import partial
from queue import SimpleQueue

import zenoh

from pincette.bus.settings import settings
from pincette.core.codec import decode, encode
from pincette.core.topics import LOOP
from pincette.instruments.link import open_link
from tests.bench.shape import (
    EXAMPLES,
    REQUESTS,
    SIZES,
    ends,
    heard,
    hop_key,
    routed_ends,
    start_key,
)

DROPPED = 2
"""Received messages that are not used further."""


def main(role: str, url: str, port: int, kind: str = "") -> None:
    """Pass messages on until standard input closes."""
    coded = kind == "coded"
    whole = coded or kind == "whole"
    place = routed_ends(port) if kind == "routed" else ends(port, role, whole=whole)
    # Same settings as in the programs, but without a guard at the port.
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings(place, role))))
    link = open_link(url, baud=115200, timeout_s=5.0) if role in REQUESTS else None
    queue: SimpleQueue[int] = SimpleQueue()
    payload = bytes(SIZES[role])
    stated = EXAMPLES[role]
    publisher = session.declare_publisher(
        hop_key(role),
        congestion_control=zenoh.CongestionControl.BLOCK,
        priority=zenoh.Priority.REAL_TIME,
    )
    before = LOOP[LOOP.index(role) - 1]
    left = 0

    def take(other: str, sample: zenoh.Sample) -> None:
        content = sample.payload.to_bytes()
        if coded:
            decode(type(EXAMPLES[other]), content)
        queue.put(1 if other == before else DROPPED)

    def begin(sample: zenoh.Sample) -> None:
        queue.put(-int(sample.payload.to_bytes()))

    keep = [
        session.declare_subscriber(hop_key(other), partial(take, other))
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
        publisher.put(encode(stated) if coded else payload)
    session.close()


def _leash(queue: "SimpleQueue[int]") -> None:
    os.read(0, 1)
    queue.put(0)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), *sys.argv[4:])
