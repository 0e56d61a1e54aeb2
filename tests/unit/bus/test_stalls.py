"""Connections that stall: the partner accepts nothing, or this process reads nothing."""

import socket
from collections.abc import Callable, Generator
from contextlib import ExitStack

import pytest

from pincette.bus.own_sockets import UNREAD_LEASES, StallWatch, limit_buffer

LEASE_S = 1000.0
"""So long that the thread of the watch makes no check during a test."""
CHECKS = 5
"""Number of checks in a lease."""


class Line:
    """A watched TCP connection, and its partner."""

    def __init__(self, stack: ExitStack) -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            self.own = stack.enter_context(socket.create_connection(server.getsockname()))
            self.partner = stack.enter_context(server.accept()[0])
        self.now_s = 0.0
        self.stalled = False
        self.watch = StallWatch(LEASE_S, lambda: self.now_s)
        stack.callback(self.watch.close)
        limit_buffer(self.own)
        self.watch.add(self.own, self.note)

    def note(self) -> None:
        self.stalled = True

    def leases_until_a_stall(self, most: int, meanwhile: Callable[[], object]) -> float | None:
        """Return the leases after which the line is shut down; None if it is not."""
        for check in range(1, most * CHECKS + 1):
            meanwhile()
            self.now_s += LEASE_S / CHECKS
            self.watch.look()
            if self.stalled:
                return check / CHECKS
        return None


@pytest.fixture
def line() -> Generator[Line]:
    with ExitStack() as stack:
        yield Line(stack)


def keep_alive(line: Line) -> None:
    line.partner.sendall(b"alive")


def test_a_connection_whose_received_data_are_never_read_is_shut_down(line: Line) -> None:
    keep_alive(line)
    leases = line.leases_until_a_stall(10, lambda: keep_alive(line))
    assert leases == pytest.approx(UNREAD_LEASES, abs=2 / CHECKS)
    assert line.partner.recv(1) == b""


def test_a_connection_that_is_read_slowly_is_kept(line: Line) -> None:
    line.partner.sendall(bytes(1000))
    read = iter(range(10_000))

    def one_byte_per_lease() -> None:
        if next(read) % CHECKS == 0:
            line.own.recv(1)

    assert line.leases_until_a_stall(20, one_byte_per_lease) is None


def test_a_connection_that_is_read_is_kept(line: Line) -> None:
    def read_all() -> None:
        keep_alive(line)
        line.own.recv(4096)

    assert line.leases_until_a_stall(20, read_all) is None


def test_a_silent_connection_is_kept(line: Line) -> None:
    assert line.leases_until_a_stall(20, lambda: None) is None


def test_a_partner_that_accepts_nothing_is_shut_down_after_a_lease(line: Line) -> None:
    line.own.setblocking(False)
    try:
        while True:
            line.own.send(bytes(60_000))
    except BlockingIOError:
        pass
    assert line.leases_until_a_stall(3, lambda: None) == pytest.approx(1.0, abs=2 / CHECKS)


def test_a_pause_of_this_process_is_no_stall(line: Line) -> None:
    keep_alive(line)
    line.watch.look()
    line.now_s += 100.0 * UNREAD_LEASES * LEASE_S
    line.watch.look()
    assert not line.stalled
