"""Rings of idle processes: over Zenoh, direct or through a router, and over other middleware."""

# Zenoh's stubs leave the return types of its calls open.
# pyright: reportUnknownMemberType=false

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from itertools import chain
from pathlib import Path
from time import sleep
from typing import Literal

from pincette.bus.session import open_session
from pincette.bus.topology import SessionConfig, endpoint, router_session
from pincette.core.topics import LOOP
from pincette.sim.wires.wire import serve
from tests.bench.loop.contestant import Contestant
from tests.bench.loop.watch import Stopwatch, blank, wait
from tests.bench.shape import start_key
from tests.support.rigs import free_ports

MATCHED_S = 1.0
"""Limit of the time until all members of a ring are connected."""
DOMAINS = 100
"""Domains of Cyclone DDS that a ring may use; each has its own ports."""
ON_LOOPBACK = """
<CycloneDDS><Domain Id="any">
  <General>
    <Interfaces><NetworkInterface name="lo"/></Interfaces>
    <AllowMulticast>false</AllowMulticast>
  </General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex>
    <Peers><Peer Address="localhost"/></Peers>
  </Discovery>
</Domain></CycloneDDS>
"""
"""Configuration of Cyclone DDS that uses no network but loopback."""
Process = subprocess.Popen[bytes]
Kind = Literal["", "routed", "whole", "coded"]


@contextmanager
def zenoh_ring(name: str, kind: Kind = "") -> Generator[Contestant]:
    """Start four processes that pass ticks on by Zenoh.

    ``routed``: only through a router; ``whole``: each also receives all topics that its service
    receives; ``coded``: each also decodes what it receives and encodes what it sends.
    """
    port = free_ports(8)
    with ExitStack() as stack:
        if kind == "routed":
            stack.enter_context(open_session(router_session("127.0.0.1", port), "bench/router"))
        wires, watch = stack.enter_context(_blank_instruments(port))
        words = [kind] if kind else []
        processes = stack.enter_context(
            _processes(["tests.bench.ring"], {role: [str(port), *words] for role in LOOP}, wires)
        )
        first = endpoint("127.0.0.1", port, "router" if kind == "routed" else LOOP[0])
        session = stack.enter_context(
            open_session(SessionConfig("client", connect=(first,)), "bench")
        )
        sleep(MATCHED_S)

        def start(ticks: int) -> None:
            session.put(start_key(), str(ticks).encode())

        yield _contestant(name, watch, processes, start)


@contextmanager
def socket_ring(name: str) -> Generator[Contestant]:
    """Start four processes that pass ticks on by Unix sockets: the cost of the machine itself."""
    pairs = [socket.socketpair() for _ in LOOP]
    with ExitStack() as stack:
        for one in chain.from_iterable(pairs):
            stack.enter_context(one)
        into = [str(far.fileno()) for _, far in pairs]
        out_of = [str(near.fileno()) for near, _ in pairs]
        yield stack.enter_context(_other_ring(name, "sockets", into, out_of, {}))


@contextmanager
def package_ring(name: str, packages: Path) -> Generator[Contestant]:
    """Start four processes that use ``zeromq`` or ``cyclonedds``, installed in the given folder."""
    ports = range(first := free_ports(len(LOOP)), first + len(LOOP))
    if name == "zeromq":
        places = [str(port) for port in ports]
    else:
        places = [f"{first % DOMAINS}:hop{place}" for place in range(len(LOOP))]
    paths = [str(packages), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    more = {"PYTHONPATH": os.pathsep.join(filter(None, paths)), "CYCLONEDDS_URI": ON_LOOPBACK}
    with _other_ring(name, name, places, places, more) as ring:
        sleep(MATCHED_S)
        yield ring


@contextmanager
def _other_ring(
    name: str, kind: str, into: Sequence[str], out_of: Sequence[str], more: Mapping[str, str]
) -> Generator[Contestant]:
    """Start four processes of ``tests.bench.others``, with the names of the two ends of each
    hop."""
    with ExitStack() as stack:
        wires, watch = stack.enter_context(_blank_instruments(free_ports(8)))
        words = {role: [into[place - 1], out_of[place]] for place, role in enumerate(LOOP)}
        module = ["tests.bench.others", kind]
        processes = stack.enter_context(_processes(module, words, wires, more))
        begin = processes[LOOP[0]].stdin
        assert begin is not None

        def start(ticks: int) -> None:
            begin.write(b"%d\n" % ticks)
            begin.flush()

        yield _contestant(name, watch, processes, start)


def _contestant(
    name: str, watch: Stopwatch, processes: Mapping[str, Process], start: Callable[[int], None]
) -> Contestant:
    def run(ticks: int) -> None:
        start(ticks)
        wait(lambda: len(watch.asked_s) >= ticks, name)

    numbers = {role: process.pid for role, process in processes.items()}
    return Contestant(name, run, watch, numbers | {"instruments": os.getpid()})


@contextmanager
def _blank_instruments(port: int) -> Generator[tuple[dict[str, str], Stopwatch]]:
    """Serve a sensor and an output without a plant; yields their urls and the stopwatch of the
    ticks."""
    watch = Stopwatch(blank)
    wires = {
        "sensor": f"socket://127.0.0.1:{port + 6}",
        "actuator": f"socket://127.0.0.1:{port + 7}",
    }
    with serve(wires["sensor"], watch), serve(wires["actuator"], Stopwatch(blank)):
        yield wires, watch


@contextmanager
def _processes(
    module: Sequence[str],
    words: Mapping[str, Sequence[str]],
    wires: Mapping[str, str],
    more: Mapping[str, str] | None = None,
) -> Generator[dict[str, Process]]:
    """Start one process per role with the url of its instrument and its own arguments; yields once
    all are ready.

    Arguments that are numbers of open sockets are inherited. ``more``: environment variables.
    """
    started = {
        role: subprocess.Popen(
            [sys.executable, "-m", *module, role, wires.get(role, "-"), *words[role]],
            env=os.environ | (more or {}),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=[int(word) for word in words[role]] if "sockets" in module else (),
        )
        for role in LOOP
    }
    try:
        for process in started.values():
            if process.stdout is None or process.stdout.readline() != b"ready\n":
                raise RuntimeError(f"a process of {' '.join(module)} did not start")
        yield started
    finally:
        for process in started.values():
            process.terminate()
            process.communicate()
