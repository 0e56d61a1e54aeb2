"""A relay between two TCP connections loses nothing, and ends when one side accepts no data."""

import secrets
import selectors
import socket
import threading
from collections.abc import Generator
from contextlib import ExitStack
from time import sleep

import pytest

from pincette.bus.own_sockets import StallWatch, limit_buffer
from pincette.bus.relay import MOST_WAITING, Relay

MEGABYTES = 4
LEASE_S = 0.5
SLACK_S = 5.0
"""Time that a busy machine may add; without the watchdog a stalled relay lasts for ever."""
CHUNK = bytes(60_000)


def connected(stack: ExitStack) -> tuple[socket.socket, socket.socket]:
    """Return both ends of a TCP connection."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        near = stack.enter_context(socket.create_connection(listener.getsockname()))
        far = stack.enter_context(listener.accept()[0])
    return near, far


@pytest.fixture
def line() -> Generator[socket.socket]:
    """Connect through a relay to a peer that sends back all that it receives."""
    with ExitStack() as stack:
        client, outer = connected(stack)
        inner, peer = connected(stack)
        selector = stack.enter_context(selectors.DefaultSelector())
        ended = threading.Event()
        relay = Relay(selector, outer, inner, lambda _relay: ended.set())
        watch = StallWatch(LEASE_S)
        for side in (outer, inner):
            side.setblocking(False)
            limit_buffer(side)
            watch.add(side, relay.note_stall)

        def carry() -> None:
            relay.begin()
            while not ended.is_set():
                for key, events in selector.select(0.1):
                    if not ended.is_set():
                        key.data(key.fileobj, events)

        def send_back() -> None:
            try:
                while found := peer.recv(65536):
                    peer.sendall(found)
            except OSError:
                return

        threads = [threading.Thread(target=one, daemon=True) for one in (carry, send_back)]
        for thread in threads:
            thread.start()
        yield client
        client.close()
        assert ended.wait(SLACK_S)
        peer.close()
        for thread in threads:
            thread.join(SLACK_S)
            assert not thread.is_alive()
        watch.close()


def test_a_slow_reader_is_waited_for_and_nothing_is_lost(line: socket.socket) -> None:
    sent = secrets.token_bytes(MEGABYTES * 1_000_000)
    assert len(sent) > 8 * MOST_WAITING
    got = bytearray()
    line.settimeout(20.0)
    sender = threading.Thread(target=line.sendall, args=(sent,))
    sender.start()
    sleep(0.3)  # all buffers in between are full
    while len(got) < len(sent):
        got += line.recv(20_000)
    sender.join()
    assert bytes(got) == sent


def test_a_link_with_both_ends_waiting_for_each_other_is_ended(
    line: socket.socket,
) -> None:
    line.settimeout(2.0 * LEASE_S + SLACK_S)
    with pytest.raises(ConnectionError):
        line.sendall(2000 * CHUNK)
