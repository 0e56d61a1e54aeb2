"""A rig that plays a recorded grip repeatedly, for tools that subscribe on the real bus."""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count

from pincette.bus.session import AskRouter, serve_router
from pincette.bus.topology import client_session, router_session
from pincette.bus.zenoh_bus import ZenohBus
from tests.support.rigs import free_ports
from tests.unit.supervisor import samples

RIG = "played"
TICK_S = 0.005
UP_S = 30.0
KNOWN_TICKS = 10
"""Ticks after which a router knows every topic."""


@dataclass(frozen=True)
class Played:
    """Address of the rig, and its messages in each tick of each epoch, except for the epoch
    itself."""

    port: int
    ticks: list[samples.Tick]

    @property
    def router(self) -> str:
        """Endpoint at which a tool joins."""
        return f"tcp/127.0.0.1:{self.port}"


@contextmanager
def played_rig() -> Generator[Played]:
    """Start a router, and behind it a grip that restarts in a new epoch when it ends."""
    port = free_ports(1)
    end, up, reported = threading.Event(), threading.Event(), threading.Event()

    def route(_ask: AskRouter) -> None:
        up.set()
        end.wait()

    def play() -> None:
        bus = ZenohBus(client_session("127.0.0.1", port), RIG, "played")
        try:
            for epoch in count(1):
                for number, tick in enumerate(samples.grip(epoch)):
                    if end.wait(TICK_S):
                        return
                    for message in tick.messages():
                        bus.publish(message)
                    # The first message of a topic announces the topic to the router.
                    if number == KNOWN_TICKS:
                        reported.set()
        finally:
            bus.close()

    ends = router_session("127.0.0.1", port)
    threads = [threading.Thread(target=serve_router, args=(ends, RIG, route))]
    threads[0].start()
    assert up.wait(UP_S)
    threads.append(threading.Thread(target=play))
    threads[1].start()
    assert reported.wait(UP_S)
    try:
        yield Played(port, samples.grip())
    finally:
        end.set()
        for thread in reversed(threads):
            thread.join()
