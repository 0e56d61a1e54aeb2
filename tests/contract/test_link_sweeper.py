"""Plain ports, on which Zenoh itself listens, and connections that never become a link."""

import os
import resource
import signal
import socket
import threading
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.bus.guard import BACKLOG
from pincette.bus.link_sweeper import MOST_PENDING, SILENT_S, LinkSweeper, reset_connection
from pincette.bus.own_sockets import own_sockets
from pincette.bus.session import open_session
from pincette.bus.topology import client_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.security.identity import Identity, program
from tests.support.bare_connects import (
    TLS_HELLO_BEGUN,
    ZENOH_INIT_BEGUN,
    descriptors,
    strangers,
)
from tests.support.certificates import folder_for
from tests.support.doors import OPENS_S, TOOL, Door, joining
from tests.support.hogs import hog
from tests.support.rigs import free_ports
from tests.support.routed import until
from tests.support.router_process import RIG, router_process

WITHIN_S = 5.0
ROUND = 1000
MOST_FILES, SETTLED_S = 600, 5.0
"""Number of open files of a program soon after a burst of connections that stay open."""
BACK_S = 5.0
"""Limit of the time until all links are back after an overload."""
JOINED_S, OVERLOAD_S = 30.0, 60.0
QUEUE, GUARD_QUEUE = 1100, BACKLOG + 100
"""Number of connections that exceeds the accept queue of a Zenoh listener or a guard."""
PARTNERS = ("sensor", "estimator", "controller", "actuator", "supervisor")


@pytest.fixture(scope="session")
def first_message() -> bytes:
    """Return the whole first message of a Zenoh session, as a client sends it."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]

        def join() -> None:
            with suppress(Exception), open_session(client_session("127.0.0.1", port), "tool"):
                pass

        joiner = threading.Thread(target=join)
        joiner.start()
        line, _ = listener.accept()
        with line:
            found = line.recv(4096)
    joiner.join()
    size = 2 + int.from_bytes(found[:2], "little")
    assert len(found) == size
    return found


@pytest.fixture
def router() -> Generator[tuple[int, int]]:
    """Port and process number of a router."""
    port = free_ports(1)
    with router_process(port) as process:
        yield port, process


@pytest.fixture(autouse=True)
def _many_files() -> Generator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def said(words: str, first_message: bytes) -> bytes:
    """Return the bytes that a kind of unknown client sends: nothing, no message, half of the first
    one, or all."""
    return {
        "silent": b"",
        "garbage": b"GET / HTTP/1.1\r\n\r\n",
        "half": ZENOH_INIT_BEGUN,
        "whole": first_message,
    }[words]


@pytest.mark.usefixtures("stalls")
@pytest.mark.parametrize(
    ("words", "stay"),
    [("silent", True), ("garbage", False), ("half", True), ("whole", False)],
)
@pytest.mark.parametrize("rounds", [1, pytest.param(10, marks=pytest.mark.slow)])
def test_a_flood_of_unknown_connections_delays_no_link(
    router: tuple[int, int],
    first_message: bytes,
    words: str,
    stay: bool,
    rounds: int,
    record_property: Callable[[str, object], None],
) -> None:
    port, process = router
    ends = client_session("127.0.0.1", port)
    with open_session(ends, "first"):
        pass  # what Zenoh opens with its first link stays open
    before, most, took_s = descriptors(process), 0, list[float]()
    for _ in range(rounds):
        with strangers([port], ROUND, words=said(words, first_message), stay=stay):
            most = max(most, descriptors(process))
            begun_s = monotonic()
            with open_session(ends, "tool"):
                took_s.append(monotonic() - begun_s)
            most = max(most, descriptors(process))
            until(lambda: descriptors(process) < MOST_FILES, SETTLED_S)
    record_property("link_ms", round(1e3 * max(took_s)))
    record_property("most_files", most)
    assert max(took_s) < OPENS_S
    assert most < before + ROUND + 2 * MOST_PENDING, "no more than one burst at any time"
    until(lambda: descriptors(process) <= before + 5, 30.0)


@pytest.mark.usefixtures("stalls")
@pytest.mark.real_time
@pytest.mark.parametrize(
    "secure", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["plain", "secure"]
)
@pytest.mark.parametrize(
    ("stopped_s", "busy_s", "stay"),
    [
        (0.5, 0.0, True),
        (3.0, 0.0, False),
        pytest.param(0.5, OVERLOAD_S, False, marks=pytest.mark.slow),
        pytest.param(3.0, OVERLOAD_S, True, marks=pytest.mark.slow),
        pytest.param(10.0, OVERLOAD_S, True, marks=pytest.mark.slow),
        pytest.param(60.0, OVERLOAD_S, False, marks=pytest.mark.slow),
    ],
)
def test_links_return_after_a_stalled_router_with_a_full_accept_queue(
    first_message: bytes,
    tmp_path: Path,
    stopped_s: float,
    busy_s: float,
    stay: bool,
    secure: bool,
    record_property: Callable[[str, object], None],
) -> None:
    """Other programs keep every processor busy, for ``busy_s`` before the router goes on."""
    folder = folder_for(tmp_path / "pki", RIG) if secure else None
    words, queue = (TLS_HELLO_BEGUN, GUARD_QUEUE) if secure else (first_message, QUEUE)
    with ExitStack() as stack:
        port = free_ports(1)
        process = stack.enter_context(router_process(port, folder))

        def bus(name: str, own: Identity, within_s: float) -> ZenohBus:
            ends = replace(joining(port, folder, own), connect_s=within_s)
            return stack.enter_context(closing(ZenohBus(ends, RIG, name)))

        for name in PARTNERS:
            bus(name, program(name, RIG), JOINED_S).announce(name)
        for _ in range(os.cpu_count() or 1):
            stack.enter_context(hog("cpu"))
        sleep(max(0.0, busy_s - stopped_s))
        os.kill(process, signal.SIGSTOP)
        try:
            with strangers([port], queue, words=words, stay=stay):
                sleep(stopped_s)
        finally:
            os.kill(process, signal.SIGCONT)
        begun_s = monotonic()
        watcher = bus("tool", TOOL, BACK_S)
        until(lambda: watcher.alive() >= set(PARTNERS), BACK_S)
        record_property("back_ms", round(1e3 * (monotonic() - begun_s)))


def test_an_accepted_connection_has_no_linger_time() -> None:
    door = Door(None)
    with closing(door.router), socket.create_connection(("127.0.0.1", door.port)) as stranger:
        name = stranger.getsockname()

        def lingers() -> list[bool]:
            option = socket.SOL_SOCKET, socket.SO_LINGER, 8
            found = list[bool]()
            for line in own_sockets():
                with suppress(OSError):
                    if line.getpeername() == name:
                        found.append(bool(line.getsockopt(*option)[0]))
            return found

        until(lambda: lingers() == [False], SILENT_S)


@pytest.mark.usefixtures("stalls")
def test_existing_links_are_kept_however_many_unknown_connections_arrive(
    first_message: bytes,
) -> None:
    """Established links are older than all unknown connections, and not silent."""
    door = Door(None)
    with ExitStack() as stack:
        stack.callback(door.router.close)
        links = [stack.enter_context(open_session(door.client, f"tool {n}")) for n in range(5)]
        with strangers([door.port], 3 * MOST_PENDING, words=first_message):
            sleep(3.0 * SILENT_S)
            assert len(door.router.session.info.links()) == len(links)
            assert all(len(one.info.links()) == 1 for one in links)


@pytest.mark.usefixtures("stalls")
def test_many_connections_from_one_address_affect_only_that_address() -> None:
    """The newest connections of the crowded address and the single connection of another address
    stay."""
    port = free_ports(1)
    accepted = list[socket.socket]()
    with ExitStack() as stack:
        listener = stack.enter_context(socket.create_server(("127.0.0.1", port)))
        sweeper = LinkSweeper([port])
        single = stack.enter_context(socket.socket())
        single.bind(("127.0.0.2", 0))
        single.connect(("127.0.0.1", port))
        accepted.append(stack.enter_context(listener.accept()[0]))
        for _ in range(MOST_PENDING + 20):
            line = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            line.sendall(b"something")
            accepted.append(stack.enter_context(listener.accept()[0]))
            sweeper.look()
        stack.callback(sweeper.close)
        assert sweeper.refused.count == 21
        states = [is_reset(line) for line in accepted]
        assert states == [False] + [True] * 21 + [False] * (MOST_PENDING - 1)


def is_reset(line: socket.socket) -> bool:
    try:
        line.getpeername()
    except OSError:
        return True
    return False


def test_a_reset_reaches_the_peer_and_leaves_other_sockets_open() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        socket.create_connection(listener.getsockname()) as near,
        listener.accept()[0] as far,
    ):
        inode = os.fstat(far.fileno()).st_ino
        assert not reset_connection(far.fileno(), inode + 1), "the descriptor was reused"
        near.sendall(b"on")
        assert far.recv(2) == b"on"
        assert reset_connection(far.fileno(), inode)
        near.settimeout(WITHIN_S)
        with pytest.raises(ConnectionResetError):
            near.recv(1)
        with pytest.raises(ConnectionResetError):
            far.recv(1)
