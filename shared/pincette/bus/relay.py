"""Relay of bytes between two non-blocking streams, each of which may use TLS."""

import selectors
import socket
import ssl
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

Stream = socket.socket | ssl.SSLSocket
CHUNK = 65536
MOST_WAITING = 4 * CHUNK
"""Number of unsent bytes for one side above which reading from the other side pauses."""
STALLED = "nothing could be sent over it for a lease"
READ, WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE
BLOCKED = (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError)


@dataclass(slots=True, eq=False)
class Side:
    """One of the two streams."""

    line: Stream
    other: "Side" = field(init=False)
    waiting: bytearray = field(default_factory=bytearray)
    """Bytes that wait to be sent to this side."""
    watched: int = 0
    """Events for which the side is registered at the selector."""

    @property
    def behind(self) -> bool:
        """Return True if so many bytes wait for this side that reading for it must pause."""
        return len(self.waiting) >= MOST_WAITING


class Relay:
    """Connects two streams, and ends when either of them ends. Used by one thread.

    Every message of the bus passes through it; usually a message is read once and sent once.
    """

    def __init__(
        self,
        selector: selectors.BaseSelector,
        outer: Stream,
        inner: Stream,
        ended: Callable[["Relay"], None],
        origin: str = "",
    ) -> None:
        self._selector, self._ended = selector, ended
        self.origin = origin
        self.why = ""
        """Reason why the relay has ended; empty before."""
        self.outer = outer
        self._outer, self._inner = Side(outer), Side(inner)
        self._outer.other, self._inner.other = self._inner, self._outer
        self._open, self._stalled = True, False

    def begin(self) -> None:
        """Begin to relay."""
        for side in (self._outer, self._inner):
            self._watch(side)
        # The selector does not report bytes that a TLS stream has read during its handshake.
        for side in (self._outer, self._inner):
            self._ready(side, side.line, READ)

    def close(self, why: str = "") -> None:
        """End both sides; does nothing if they have ended."""
        if not self._open:
            return
        self._open, self.why = False, STALLED if self._stalled else why
        for side in (self._outer, self._inner):
            if side.watched:
                self._selector.unregister(side.line)
            side.line.close()
        self._ended(self)

    def note_stall(self) -> None:
        """Note that a side is about to be shut down because it stalls.

        May be called from any thread.
        """
        self._stalled = True

    def _ready(self, side: Side, _line: Stream, events: int) -> None:
        try:
            if events & WRITE:
                self._send(side)
            self._read(side)
        except OSError as error:
            self.close(error.strerror or str(error))
        # Usually nothing waits, and the registrations of both sides do not change.
        for one in (side, side.other):
            if one.waiting or one.watched != READ:
                self._watch(one)
                self._watch(one.other)

    def _read(self, side: Side) -> None:
        """Read the available bytes and send them on, unless too many bytes already wait for the
        other side.
        """
        other = side.other
        while self._open and not other.behind:
            try:
                found = side.line.recv(CHUNK)
            except BLOCKED:
                return
            if not found:
                self.close("it hung up" if side is self._outer else "")
                return
            if other.waiting:
                other.waiting += found
                self._send(other)
            elif (sent := _sent(other.line, found)) < len(found):
                other.waiting += found[sent:]
            if not _holds_more(side.line):
                return

    def _send(self, side: Side) -> None:
        was_behind = side.behind
        while side.waiting and (sent := _sent(side.line, side.waiting)):
            del side.waiting[:sent]
        if was_behind and not side.behind:
            # A TLS stream may contain bytes that it has already read; no event reports them.
            self._read(side.other)

    def _watch(self, side: Side) -> None:
        """Register the events for which a side waits; unregister the side if there are none."""
        if not self._open:
            return
        wanted = (0 if side.other.behind else READ) | (WRITE if side.waiting else 0)
        if wanted == side.watched:
            return
        if side.watched:
            self._selector.unregister(side.line)
        if wanted:
            self._selector.register(side.line, wanted, partial(self._ready, side))
        side.watched = wanted


def _sent(line: Stream, data: bytes | bytearray) -> int:
    """Return the number of bytes that the stream has accepted."""
    try:
        return line.send(data)
    except BLOCKED:
        return 0


def _holds_more(line: Stream) -> bool:
    """Return whether the stream contains buffered bytes, which no event would report."""
    return isinstance(line, ssl.SSLSocket) and line.pending() > 0
