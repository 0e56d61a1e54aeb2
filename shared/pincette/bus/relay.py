"""Carries bytes both ways between two non-blocking streams, either of which may be a TLS stream."""

import selectors
import socket
import ssl
from collections.abc import Callable

Stream = socket.socket | ssl.SSLSocket
CHUNK = 65536
MOST_WAITING = 4 * CHUNK
"""Bytes for one side that may wait to be sent before nothing more is read of the other side."""
READ, WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE


class Relay:
    """Two streams that are each other's end; ends when either does. Used by one thread."""

    def __init__(
        self,
        selector: selectors.BaseSelector,
        outer: Stream,
        inner: Stream,
        ended: Callable[["Relay"], None],
        whence: str = "",
    ) -> None:
        self._selector, self._ended = selector, ended
        self.whence = whence
        self.why = ""
        """Why it has ended; empty before."""
        self.sides = (outer, inner)
        self._waiting = {outer: bytearray(), inner: bytearray()}
        """Bytes that are to be sent to each side."""

    def begin(self) -> None:
        """Carry what comes from now on."""
        for one in self.sides:
            self._selector.register(one, READ, self._ready)
        # What a TLS stream has read with its handshake is not told by the selector.
        for one in self.sides:
            self._ready(one, READ)

    def close(self, why: str = "") -> None:
        """End both sides; nothing happens where they have ended."""
        if not self._waiting:
            return
        self._waiting, self.why = {}, why
        for one in self.sides:
            if one in self._selector.get_map():
                self._selector.unregister(one)
            one.close()
        self._ended(self)

    def _other(self, side: Stream) -> Stream:
        return self.sides[1] if side is self.sides[0] else self.sides[0]

    def _ready(self, side: Stream, events: int) -> None:
        try:
            if self._waiting and events & WRITE:
                self._send(side)
            if self._waiting:
                self._read(side)
            if self._waiting:
                self._watch()
        except OSError as error:
            self.close(error.strerror or str(error))

    def _read(self, side: Stream) -> None:
        """Take what there is, unless the other side is behind; at once to the other side."""
        other = self._other(side)
        while self._waiting and len(self._waiting[other]) < MOST_WAITING:
            try:
                found = side.recv(CHUNK)
            except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
                return
            if not found:
                self.close("it hung up" if side is self.sides[0] else "")
                return
            self._waiting[other] += found
            self._send(other)

    def _send(self, side: Stream) -> None:
        waiting = self._waiting[side]
        full = len(waiting) >= MOST_WAITING
        try:
            while waiting:
                del waiting[: side.send(waiting)]
        except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
            pass
        if full and len(waiting) < MOST_WAITING:
            # A TLS stream may hold what it has read already, which no event will tell.
            self._read(self._other(side))

    def _watch(self) -> None:
        """Tell the selector what each side is waited for; a side for nothing is left out."""
        watched = self._selector.get_map()
        for one in self.sides:
            behind = len(self._waiting[self._other(one)]) >= MOST_WAITING
            wanted = (0 if behind else READ) | (WRITE if self._waiting[one] else 0)
            if one not in watched:
                if wanted:
                    self._selector.register(one, wanted, self._ready)
            elif not wanted:
                self._selector.unregister(one)
            elif watched[one].events != wanted:
                self._selector.modify(one, wanted, self._ready)
