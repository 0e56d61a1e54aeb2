"""Stands at a program's TLS ports, so that no stranger keeps others from the Zenoh behind it.

Zenoh takes one failed handshake after another, at a tenth of a second each. The guard has many of
them at once, each with its time limit, and drops the oldest of whoever has the most. Only who has
proved itself is led on to Zenoh.
"""

import errno
import logging
import os
import selectors
import socket
import ssl
import struct
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import chain
from time import monotonic, sleep

from pincette.bus.private_port import PrivatePort
from pincette.bus.protocol import BusError
from pincette.bus.relay import READ, WRITE, Relay, Stream
from pincette.bus.vouching import Vouching

log = logging.getLogger("pincette")
MOST_PENDING = 128
"""Connections that have not yet proved who they are."""
MOST_LINKS = 512
HELLO_S, PROOF_S = 1.0, 3.0
"""Limits of the wait for the first bytes of a handshake, and for its end."""
BATCH = 64
"""Connections that are taken before the links have their turn again."""
BACKLOG = 4096
PAUSE_S = 0.01
"""Where no file can be opened any more."""
HELLO = b"\x16\x03"
"""How a TLS handshake begins: a record of that type, of version 3."""


class Stage(StrEnum):
    """What is waited for of a connection."""

    HELLO = "the first bytes of a handshake"
    PROOF = "its end"
    CONNECT = "a connection with Zenoh"
    VOUCH = "the end of the handshake with Zenoh"


@dataclass(slots=True, eq=False)
class Pending:
    """A connection that is on its way in."""

    address: str
    until_s: float
    outer: Stream
    inner: Stream | None = None
    stage: Stage = Stage.HELLO


@dataclass(slots=True)
class Count:
    """What a guard has seen."""

    admitted: int = 0
    refused: int = 0
    """Handshakes that failed, or came to no end in time."""
    dropped: int = 0
    """Ended to make room for others."""


class Guard:
    """One thread that takes connections at some ports, and leads them on to one behind them."""

    def __init__(
        self, places: Sequence[tuple[str, int]], behind: PrivatePort, vouching: Vouching
    ) -> None:
        """Listen; raises OSError where a place is taken."""
        self.count = Count()
        self._behind, self._vouching = behind, vouching
        self._selector = selectors.DefaultSelector()
        self._by_address: dict[str, dict[Pending, None]] = {}
        self._pending = 0
        self._relays: set[Relay] = set()
        self._wake, self._woken = socket.socketpair()
        self._selector.register(self._woken, READ, None)
        self._listeners = list[socket.socket]()
        try:
            for place in places:
                self._listeners.append(_listening(place))
        except OSError:
            self._release()
            raise
        for listener in self._listeners:
            self._selector.register(listener, READ, self._accept)
        self._thread = threading.Thread(target=self._run, name="guard", daemon=True)

    def start(self) -> None:
        """Let connections in, once Zenoh listens behind."""
        self._thread.start()

    def close(self) -> None:
        """End every connection."""
        self._wake.send(b".")
        if self._thread.is_alive():
            self._thread.join()
        self._release()

    def _release(self) -> None:
        for relay in list(self._relays):
            relay.close()
        for one in list(chain.from_iterable(self._by_address.values())):
            self._end(one, _reset)
        for line in (*self._listeners, self._wake, self._woken):
            line.close()
        self._selector.close()

    def _run(self) -> None:
        while True:
            found = self._selector.select(0.1 if self._pending else None)
            for key, events in found:
                if key.fileobj is self._woken:
                    return
                # What an earlier event of the same round has ended is closed.
                if key.fileobj.fileno() >= 0:  # pyright: ignore[reportAttributeAccessIssue]
                    key.data(key.fileobj, events)
            if self._pending:
                self._end_overdue(monotonic())

    def _accept(self, listener: socket.socket, _events: int) -> None:
        for _ in range(BATCH):
            try:
                line, address = listener.accept()
            except OSError as error:
                if error.errno in (errno.EMFILE, errno.ENFILE):
                    self._make_room()
                    sleep(PAUSE_S)
                return
            if len(self._relays) >= MOST_LINKS:
                self.count.dropped += 1
                _reset(line)
                continue
            if self._pending >= MOST_PENDING:
                self._make_room()
            line.setblocking(False)
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            one = Pending(address[0], monotonic() + HELLO_S, line)
            self._by_address.setdefault(one.address, {})[one] = None
            self._pending += 1
            self._await(one, line, READ)
            self._advance(one)

    def _await(self, one: Pending, line: Stream, events: int) -> None:
        self._selector.register(line, events, lambda _line, _events: self._advance(one))

    def _make_room(self) -> None:
        """End the oldest of the address that has most; one that has said nothing goes first."""
        if not self._pending:
            return
        crowd = max(self._by_address.values(), key=len)
        silent = (one for one in crowd if one.stage is Stage.HELLO)
        victim = next(silent, None) or next(iter(crowd))
        self.count.dropped += 1
        self._end(victim, _reset)

    def _end_overdue(self, now_s: float) -> None:
        for one in list(chain.from_iterable(self._by_address.values())):
            if now_s > one.until_s:
                self.count.refused += 1
                self._end(one, _reset)

    def _advance(self, one: Pending) -> None:
        """Do what can be done without waiting."""
        try:
            while STEPS[one.stage](self, one):
                if one.stage is Stage.VOUCH:
                    self._admit(one)
                    return
                one.stage = AFTER[one.stage]
        except (OSError, BusError, ValueError) as error:
            log.debug("guard: %s, while waiting for %s: %s", one.address, one.stage, error)
            self.count.refused += 1
            self._end(one, socket.socket.close)

    def _hello(self, one: Pending) -> bool:
        try:
            first = one.outer.recv(len(HELLO), socket.MSG_PEEK)
        except BlockingIOError:
            return False
        if not first or not HELLO.startswith(first):
            raise ConnectionError("no handshake")
        if first != HELLO:
            return False
        self._selector.unregister(one.outer)
        one.outer = self._vouching.outer.wrap_socket(
            one.outer, server_side=True, do_handshake_on_connect=False
        )
        self._await(one, one.outer, READ)
        one.until_s = monotonic() + PROOF_S
        return True

    def _proof(self, one: Pending) -> bool:
        if not self._shaken(one.outer):
            return False
        self._selector.unregister(one.outer)
        one.inner = self._behind.connecting()
        self._await(one, one.inner, WRITE)
        return True

    def _connect(self, one: Pending) -> bool:
        outer, inner = one.outer, one.inner
        if not isinstance(outer, ssl.SSLSocket) or inner is None:
            raise BusError("no handshake")
        if trouble := inner.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            raise ConnectionError(os.strerror(trouble))
        try:
            inner.getpeername()
        except OSError:  # still on its way
            return False
        self._selector.unregister(inner)
        one.inner = self._vouching.inner(outer.getpeercert()).wrap_socket(
            inner, do_handshake_on_connect=False
        )
        self._await(one, one.inner, WRITE)
        return True

    def _vouch(self, one: Pending) -> bool:
        return one.inner is not None and self._shaken(one.inner)

    def _shaken(self, line: Stream) -> bool:
        """Whether a handshake is done; else the selector is told what it waits for."""
        if not isinstance(line, ssl.SSLSocket):
            raise BusError("no handshake")
        try:
            line.do_handshake()
        except ssl.SSLWantReadError:
            self._selector.modify(line, READ, self._selector.get_key(line).data)
            return False
        except ssl.SSLWantWriteError:
            self._selector.modify(line, WRITE, self._selector.get_key(line).data)
            return False
        return True

    def _admit(self, one: Pending) -> None:
        inner, outer = one.inner, one.outer
        if inner is None:
            return
        self._forget(one)
        self._selector.unregister(inner)
        self.count.admitted += 1
        relay = Relay(self._selector, outer, inner, self._relays.discard)
        self._relays.add(relay)
        relay.begin()

    def _forget(self, one: Pending) -> None:
        crowd = self._by_address[one.address]
        del crowd[one]
        if not crowd:
            del self._by_address[one.address]
        self._pending -= 1

    def _end(self, one: Pending, close: Callable[[Stream], None]) -> None:
        self._forget(one)
        for line in (one.outer, one.inner):
            if line is not None:
                if line in self._selector.get_map():
                    self._selector.unregister(line)
                close(line)


Step = Callable[[Guard, Pending], bool]
STEPS: dict[Stage, Step] = {
    Stage.HELLO: Guard._hello,
    Stage.PROOF: Guard._proof,
    Stage.CONNECT: Guard._connect,
    Stage.VOUCH: Guard._vouch,
}
AFTER = {Stage.HELLO: Stage.PROOF, Stage.PROOF: Stage.CONNECT, Stage.CONNECT: Stage.VOUCH}


def _reset(line: Stream) -> None:
    """End a connection without a trace in the kernel."""
    line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    line.close()


def _listening(place: tuple[str, int]) -> socket.socket:
    host, port = place
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(BACKLOG)
        listener.setblocking(False)
    except OSError:
        listener.close()
        raise
    return listener
