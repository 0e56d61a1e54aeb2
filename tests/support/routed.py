"""A router for one test, and clients connected to it."""

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from time import monotonic, sleep

from pincette.bus.session import AskRouter, serve_router
from pincette.bus.topology import SessionConfig, client_session, router_session
from tests.support.rigs import free_ports

WAIT_S = 30.0


@contextmanager
def router(rig: str) -> Generator[SessionConfig]:
    """Run a router in a thread; yields the endpoint of a tool."""
    port = free_ports(1)
    end, up = threading.Event(), threading.Event()

    def wait(_ask: AskRouter) -> None:
        up.set()
        end.wait()

    thread = threading.Thread(
        target=serve_router, args=(router_session("127.0.0.1", port), rig, wait)
    )
    thread.start()
    try:
        assert up.wait(WAIT_S)
        yield client_session("127.0.0.1", port)
    finally:
        end.set()
        thread.join()


def until(done: Callable[[], object], wait_s: float = WAIT_S) -> None:
    """Poll for a condition: declarations and messages need a moment between sessions."""
    deadline = monotonic() + wait_s
    while not done():
        assert monotonic() < deadline
        sleep(0.005)
