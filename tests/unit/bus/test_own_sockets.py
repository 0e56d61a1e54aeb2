"""Sockets of this process that Zenoh closes while they are examined."""

import os
import socket
from collections.abc import Generator
from contextlib import contextmanager

import pytest

from pincette.bus import link_sweeper, private_port
from pincette.bus.link_sweeper import LinkSweeper
from pincette.bus.private_port import PrivatePort


@pytest.fixture(autouse=True)
def closed_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Yield first a socket whose descriptor is closed before it is examined."""

    def sockets() -> Generator[socket.socket]:
        gone = socket.socket()
        os.close(gone.fileno())
        try:
            yield gone
        finally:
            gone.detach()
        yield from real()

    real = link_sweeper.own_sockets
    monkeypatch.setattr(link_sweeper, "own_sockets", sockets)
    monkeypatch.setattr(private_port, "own_sockets", sockets)


@contextmanager
def listener() -> Generator[int]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield int(server.getsockname()[1])


def test_a_sweeper_starts_without_the_socket_option() -> None:
    with listener() as port:
        sweeper = LinkSweeper([port])
        sweeper.start()
        sweeper.close()


def test_the_listener_of_a_private_port_is_signed_without_the_socket_option() -> None:
    with listener() as port:
        assert PrivatePort("127.0.0.1", port, b"key").sign_listener() is not None
