"""A simulated instrument on a port: one thread that splits bytes into lines and answers them."""

import os
import select
import threading
import time
from contextlib import suppress

from pincette.sim.instrument import TERMINATOR, Instrument
from pincette.sim.ports import Line, Port, open_port

BITS_PER_BYTE = 10
LONGEST_LINE = 256
IDLE_S = 0.05


class Wire:
    """Serves one instrument until it is closed; a client that comes back is served again."""

    def __init__(
        self, port: Port, instrument: Instrument, baud: int | None, terminator: bytes
    ) -> None:
        self._port = port
        self._instrument = instrument
        self._terminator = terminator
        self._byte_s = BITS_PER_BYTE / baud if baud else 0.0
        self._wake, self._waker = os.pipe()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=port.url, daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """What a driver opens to get here."""
        return self._port.url

    def close(self) -> None:
        """Hang up, free the port, and wait for the thread; twice is once."""
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
            # A client may be gone, or deaf, in the middle of an answer; the next begins afresh.
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
        """Answer one client until it hangs up; a line that never ends is dropped."""
        pending = b""
        while self._wait(line.fileno()):
            chunk = line.recv(4096)
            if not chunk:
                return
            *requests, pending = (pending + chunk).split(self._terminator)
            pending = pending if len(pending) <= LONGEST_LINE else b""
            for request in requests:
                self._take_time(len(request) + len(self._terminator))
                reply = self._instrument.answer(request)
                if reply is not None:
                    self._take_time(len(reply) + len(self._terminator))
                    line.sendall(reply + self._terminator)

    def _take_time(self, count: int) -> None:
        if self._byte_s:
            time.sleep(count * self._byte_s)


def serve(
    url: str,
    instrument: Instrument,
    baud: int | None = None,
    terminator: bytes = TERMINATOR,
) -> Wire:
    """Offer an instrument at a driver's url.

    Parameters
    ----------
    baud
        Each byte takes ten bits at this rate, in both directions; None takes no time.
    terminator
        Ends each line, in both directions.

    Raises
    ------
    WireError
        Where the port is taken, or is none.
    """
    return Wire(open_port(url), instrument, baud, terminator)
