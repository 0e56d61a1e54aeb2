"""A link that came up before the previous one to the same place had ended is ended too."""

import socket
from collections.abc import Callable, Generator
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh

from pincette.bus.own_sockets import StallWatch
from pincette.bus.session import Joined

LEASE_S = 1000.0


class Info:
    """Reports the links of a session when a test says so."""

    def __init__(self) -> None:
        self.note: Callable[[Any], None] = lambda _event: None

    def declare_link_events_listener(self, note: Callable[[Any], None], *, history: bool) -> object:
        assert history
        self.note = note
        return SimpleNamespace(undeclare=lambda: None)


class Links:
    """A session's links to one place."""

    def __init__(self, stack: ExitStack) -> None:
        self.stack, self.info = stack, Info()
        self.server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        session = SimpleNamespace(info=self.info, close=lambda: None)
        joined = Joined(cast(zenoh.Session, session), StallWatch(LEASE_S))
        stack.callback(joined.close)

    def made(self) -> tuple[socket.socket, socket.socket]:
        """Return both ends of a new connection, the session's first."""
        own = self.stack.enter_context(socket.create_connection(self.server.getsockname()))
        return own, self.stack.enter_context(self.server.accept()[0])

    def report(self, kind: zenoh.SampleKind, own: socket.socket) -> None:
        ends = [f"tcp/{host}:{port}" for host, port in (own.getsockname(), own.getpeername())]
        link = SimpleNamespace(src=ends[0], dst=ends[1], auth_identifier=None)
        self.info.note(SimpleNamespace(kind=kind, link=link))


@pytest.fixture
def links() -> Generator[Links]:
    with ExitStack() as stack:
        yield Links(stack)


def ended(partner: socket.socket) -> bool:
    partner.setblocking(False)
    try:
        return partner.recv(1) == b""
    except BlockingIOError:
        return False


def test_a_link_that_comes_up_before_the_previous_one_has_ended_is_ended_too(links: Links) -> None:
    first, _ = links.made()
    second, partner = links.made()
    links.report(zenoh.SampleKind.PUT, first)
    links.report(zenoh.SampleKind.PUT, second)
    assert not ended(partner)
    links.report(zenoh.SampleKind.DELETE, first)
    assert ended(partner)


def test_a_link_that_comes_up_after_the_end_of_the_previous_one_is_kept(links: Links) -> None:
    first, _ = links.made()
    second, partner = links.made()
    links.report(zenoh.SampleKind.PUT, first)
    links.report(zenoh.SampleKind.DELETE, first)
    links.report(zenoh.SampleKind.PUT, second)
    assert not ended(partner)
