"""One process of a ring without Zenoh: the loop's hops, payloads and serial exchanges, no work.

    python -m tests.bench.others KIND ROLE URL IN OUT

It passes on what it receives from the process before it. A kind determines what links the
processes, and what IN and OUT are:

- ``sockets``: Unix sockets; two descriptors.
- ``zeromq``: publishers and subscribers of ZeroMQ over TCP; two ports.
- ``cyclonedds``: reliable topics of Cyclone DDS over UDP; two names, each ``DOMAIN:TOPIC``.

The sensor reads numbers of ticks from standard input, one a line; the others end with the ring.
"""

import signal
import socket
import sys
from collections.abc import Callable
from dataclasses import make_dataclass
from functools import partial
from importlib import import_module
from typing import Any

from pincette.instruments.link import open_link
from tests.bench.shape import REQUESTS, SIZES

READ_SIZE = 4096
RELIABLE_S = 1.0
"""Longest time for which a reliable writer of Cyclone DDS waits for its reader."""
Ends = tuple[Callable[[], bytes], Callable[[bytes], object]]
"""Functions that receive from the process before, and send to the one after."""


def by_sockets(descriptor_in: str, descriptor_out: str) -> Ends:
    """Use two Unix sockets that the parent has opened."""
    before, after = (socket.socket(fileno=int(one)) for one in (descriptor_in, descriptor_out))
    return partial(before.recv, READ_SIZE), after.sendall


def by_zeromq(port_in: str, port_out: str) -> Ends:
    """Publish at one port, and subscribe to everything at another."""
    zmq: Any = import_module("zmq")
    context = zmq.Context.instance()
    before, after = context.socket(zmq.SUB), context.socket(zmq.PUB)
    after.bind(f"tcp://127.0.0.1:{port_out}")
    before.connect(f"tcp://127.0.0.1:{port_in}")
    before.subscribe(b"")
    return before.recv, after.send


def by_cyclonedds(topic_in: str, topic_out: str) -> Ends:
    """Write one topic and read another, both reliable and without history."""
    parts = ("core", "domain", "idl", "idl.types", "pub", "sub", "topic", "util")
    dds: dict[str, Any] = {name: import_module(f"cyclonedds.{name}") for name in parts}
    types, policy = dds["idl.types"], dds["core"].Policy
    fields = [("content", types.sequence[types.uint8])]
    payload: Any = make_dataclass("Payload", fields, bases=(dds["idl"].IdlStruct,))
    patience = policy.Reliability.Reliable(dds["util"].duration(seconds=RELIABLE_S))
    qos = dds["core"].Qos(patience, policy.History.KeepLast(1))
    domain, name_in = topic_in.split(":")
    participant = dds["domain"].DomainParticipant(int(domain))
    topics = [
        dds["topic"].Topic(participant, name, payload, qos=qos)
        for name in (name_in, topic_out.split(":")[1])
    ]
    reader = dds["sub"].DataReader(participant, topics[0], qos=qos)
    writer = dds["pub"].DataWriter(participant, topics[1], qos=qos)

    samples = reader.take_iter()
    return lambda: next(samples).content, lambda content: writer.write(payload(content))


KINDS: dict[str, Callable[[str, str], Ends]] = {
    "sockets": by_sockets,
    "zeromq": by_zeromq,
    "cyclonedds": by_cyclonedds,
}


def main(kind: str, role: str, url: str, before: str, after: str) -> None:
    """Pass messages on until the previous process disconnects or this one is stopped."""
    link = open_link(url, baud=115200, timeout_s=5.0) if role in REQUESTS else None
    receive, send = KINDS[kind](before, after)
    payload = bytes(SIZES[role])
    sys.stdout.write("ready\n")
    sys.stdout.flush()

    def hand_on() -> None:
        if link is not None:
            link.exchange(REQUESTS[role])
        send(payload)

    if role == "sensor":
        for line in sys.stdin:
            for _ in range(int(line)):
                hand_on()
                receive()
    else:
        while receive():
            hand_on()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    main(*sys.argv[1:])
