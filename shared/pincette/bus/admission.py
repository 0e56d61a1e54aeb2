"""Admission of connections by a guard, one handshake step at a time, without blocking."""

import os
import selectors
import socket
import ssl
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from time import monotonic

from pincette.bus.private_port import PrivatePort
from pincette.bus.protocol import BusError
from pincette.bus.relay import READ, WRITE, Stream
from pincette.bus.vouching import Vouching

HELLO_S, PROOF_S = 1.0, 3.0
"""Time limits, in s, for the first bytes, and for everything after them."""
TLS_HANDSHAKE = b"\x16\x03"
"""First bytes of TLS: a handshake record, version 3."""


class Stage(Enum):
    """Event for which a pending connection waits next."""

    HELLO = auto()
    """The first bytes of the client."""
    PROOF = auto()
    """The end of the handshake with the client."""
    CONNECT = auto()
    """The established connection to Zenoh."""
    VOUCH = auto()
    """The end of the handshake with Zenoh."""
    ADMITTED = auto()


@dataclass(slots=True, eq=False)
class Pending:
    """A connection that is being admitted.

    ``inner`` is the corresponding connection to Zenoh.
    """

    address: str
    port: int
    outer: Stream
    until_s: float
    inner: Stream | None = None
    stage: Stage = Stage.HELLO

    @property
    def silent(self) -> bool:
        """Return True if no byte has arrived."""
        return self.stage is Stage.HELLO


class Admission:
    """Admits connections that present a valid certificate, and connects them to Zenoh."""

    def __init__(
        self,
        selector: selectors.BaseSelector,
        behind: PrivatePort,
        vouching: Vouching,
        advance: Callable[[Pending], None],
    ) -> None:
        self._selector, self._behind, self._vouching = selector, behind, vouching
        self._advance = advance
        """Function that is called when a connection may continue."""
        self._steps: dict[Stage, Callable[[Pending], Stage]] = {
            Stage.HELLO: self._hello,
            Stage.PROOF: self._proof,
            Stage.CONNECT: self._connect,
            Stage.VOUCH: self._vouch,
        }

    def begin(self, line: socket.socket, address: str, port: int) -> Pending:
        """Begin to admit a connection."""
        line.setblocking(False)
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        one = Pending(address, port, line, monotonic() + HELLO_S)
        self._await(one, line, READ)
        return one

    def lead(self, one: Pending) -> bool:
        """Continue as far as possible without waiting; return True once the connection is admitted.

        Raises OSError, BusError or ValueError if it is rejected.
        """
        while one.stage is not Stage.ADMITTED:
            before, one.stage = one.stage, self._steps[one.stage](one)
            if one.stage is before:
                return False
        for line in (one.outer, one.inner):
            self._forget(line)
        return True

    def end(self, one: Pending, close: Callable[[Stream], None]) -> None:
        """End both connections; ``close`` ends the outer one.

        The inner one is reset, so that Zenoh's accepting thread does not have to wait for it.
        """
        for line in (one.outer, one.inner):
            self._forget(line)
        close(one.outer)
        if one.inner is not None:
            reset(one.inner)

    def _await(self, one: Pending, line: Stream, events: int) -> None:
        def go_on(_line: Stream, _events: int) -> None:
            self._advance(one)

        self._selector.register(line, events, go_on)

    def _forget(self, line: Stream | None) -> None:
        if line is not None and line in self._selector.get_map():
            self._selector.unregister(line)

    def _hello(self, one: Pending) -> Stage:
        try:
            first = one.outer.recv(len(TLS_HANDSHAKE), socket.MSG_PEEK)
        except BlockingIOError:
            return Stage.HELLO
        if not first:
            raise ConnectionError("ended")
        if not _tls_begins(first):
            # The selector would report these bytes again and again; therefore the guard checks at
            # intervals instead.
            self._forget(one.outer)
            return Stage.HELLO
        one.until_s = monotonic() + PROOF_S
        self._forget(one.outer)
        one.outer = self._vouching.outer.wrap_socket(
            one.outer, server_side=True, do_handshake_on_connect=False
        )
        self._await(one, one.outer, READ)
        return Stage.PROOF

    def _proof(self, one: Pending) -> Stage:
        if not self._shaken(one.outer):
            return Stage.PROOF
        self._selector.unregister(one.outer)
        return self._connecting(one)

    def _connecting(self, one: Pending) -> Stage:
        one.inner = self._behind.connecting()
        self._await(one, one.inner, WRITE)
        return Stage.CONNECT

    def _connect(self, one: Pending) -> Stage:
        inner = one.inner
        if inner is None:
            raise BusError("no connection with Zenoh")
        if trouble := inner.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            raise ConnectionError(os.strerror(trouble))
        try:
            inner.getpeername()
        except OSError:  # not connected yet
            return Stage.CONNECT
        if not isinstance(one.outer, ssl.SSLSocket):
            raise BusError("no handshake")
        self._selector.unregister(inner)
        context = self._vouching.inner(one.outer.getpeercert())
        one.inner = context.wrap_socket(inner, do_handshake_on_connect=False)
        self._await(one, one.inner, WRITE)
        return Stage.VOUCH

    def _vouch(self, one: Pending) -> Stage:
        if one.inner is None or not self._shaken(one.inner):
            return Stage.VOUCH
        return Stage.ADMITTED

    def _shaken(self, line: Stream) -> bool:
        """Return whether a handshake is complete.

        If it is not, register the event for which it waits.
        """
        if not isinstance(line, ssl.SSLSocket):
            raise BusError("no handshake")
        try:
            line.do_handshake()
        except (ssl.SSLWantReadError, ssl.SSLWantWriteError) as error:
            events = READ if isinstance(error, ssl.SSLWantReadError) else WRITE
            self._selector.modify(line, events, self._selector.get_key(line).data)
            return False
        return True


def _tls_begins(first: bytes) -> bool:
    """Return whether a handshake has begun; raises ConnectionError if the bytes are not TLS."""
    if not TLS_HANDSHAKE.startswith(first[:2]):
        raise ConnectionError("no handshake")
    return len(first) >= len(TLS_HANDSHAKE)


def reset(line: Stream) -> None:
    """Close a connection by a reset, so that the kernel keeps no state of it."""
    line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    line.close()
