"""Simulated instrument at a port: a thread splits the bytes into lines and answers them."""

import os
import select
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from pincette.sim.instruments.protocol import TERMINATOR, Instrument
from pincette.sim.wires.ports import Line, Port, open_port

BITS_PER_BYTE = 10
LONGEST_LINE = 256
IDLE_S = 0.05
PIECE_S = 0.0005
"""Duration in s of the pieces in which an answer is delivered; each has at least one byte."""

Garble = Callable[[bytes], bytes]
"""Function that returns a corrupted form of an answer, with its terminator."""
Afterwards = Callable[[], None]
"""Function that runs work for which the answer need not wait."""


def _untouched(data: bytes) -> bytes:
    return data


def _nothing() -> None:
    pass


class Wire:
    """Server of one instrument until it is closed; a client may connect again."""

    def __init__(
        self,
        port: Port,
        instrument: Instrument,
        baud: int | None,
        terminator: bytes,
        garble: Garble,
        afterwards: Afterwards,
    ) -> None:
        self._port = port
        self._afterwards = afterwards
        self._garble = garble
        self._instrument = instrument
        self._terminator = terminator
        self._byte_s = BITS_PER_BYTE / baud if baud else 0.0
        self._wake, self._waker = os.pipe()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=port.url, daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Return the url for a driver."""
        return self._port.url

    def close(self) -> None:
        """Hang up, free the port, and wait for the thread; repeated calls do nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        os.write(self._waker, b".")
        self._thread.join()
        self._port.close()
        os.close(self._wake)
        os.close(self._waker)

    def __enter__(self) -> "Wire":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        while (line := self._port.next_line(self._wait)) is not None:
            # A client may disconnect, or stop reading, within an answer; the next client starts a
            # new conversation.
            with suppress(OSError):
                self._converse(line)
            line.close()

    def _wait(self, descriptor: int) -> bool:
        while True:
            ready, _, _ = select.select([descriptor, self._wake], [], [], IDLE_S)
            if self._wake in ready:
                return False
            if ready:
                return True
            self._instrument.idle()

    def _converse(self, line: Line) -> None:
        """Answer one client until it hangs up; drops a line that never ends."""
        pending = b""
        while self._wait(line.fileno()):
            chunk = line.recv(4096)
            if not chunk:
                return
            *requests, pending = (pending + chunk).split(self._terminator)
            pending = pending if len(pending) <= LONGEST_LINE else b""
            for request in requests:
                self._pass(self._byte_s * (len(request) + len(self._terminator)))
                reply = self._instrument.answer(request)
                if reply is not None:
                    self._deliver(line, self._garble(reply + self._terminator))
                self._afterwards()

    def _deliver(self, line: Line, data: bytes) -> None:
        """Send an answer in pieces, at the speed of the line."""
        if not self._byte_s:
            line.sendall(data)
            return
        piece = max(1, int(PIECE_S / self._byte_s))
        began_s, sent = time.monotonic(), 0
        while sent < len(data):
            self._pass(began_s + self._byte_s * min(sent + piece, len(data)) - time.monotonic())
            # Add half the time of a byte, because the clock is read at discrete times.
            carried = int((time.monotonic() - began_s) / self._byte_s + 0.5)
            line.sendall(data[sent:carried])
            sent = max(sent, carried)

    @staticmethod
    def _pass(duration_s: float) -> None:
        if duration_s > 0.0:
            time.sleep(duration_s)


def serve(
    url: str,
    instrument: Instrument,
    baud: int | None = None,
    terminator: bytes = TERMINATOR,
    garble: Garble = _untouched,
    afterwards: Afterwards = _nothing,
) -> Wire:
    """Open a port for an instrument at a url, with immediate answers or at ``baud``; WireError."""
    return Wire(open_port(url), instrument, baud, terminator, garble, afterwards)
