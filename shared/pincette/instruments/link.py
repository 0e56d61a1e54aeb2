"""The one line to a real instrument: a serial port, or a socket that stands for one.

The only file that imports serial. Where the port has a descriptor it never blocks
(``timeout=0``) and the wait is a select, so that an answer is taken as it arrives, in as few calls
as it has pieces.
"""

import io
import logging
import os
import select
import socket
import termios
import time
from collections.abc import Callable
from typing import Protocol

import serial

from pincette.instruments.protocols import InstrumentError, Link

LONGEST_FRAME = 256
READ_SIZE = 4096
GRACE = 0.2
"""Share of the timeout that is waited once more where it has passed: the time may have passed while
the machine stood still, with the answer on its way all along."""

_log = logging.getLogger(__name__)


def _every(_line: bytes) -> bool:
    return True


def open_link(
    url: str,
    *,
    baud: int,
    timeout_s: float,
    terminator: bytes = b"\r",
    accept: Callable[[bytes], bool] = _every,
) -> Link:
    """Open a line: ``/dev/…`` at 8N1 without flow control, or ``socket://host:port``.

    Parameters
    ----------
    timeout_s
        For a whole exchange.
    accept
        Whether a line can be an answer; others are skipped as unsolicited.

    Raises
    ------
    InstrumentError
        Where the port cannot be opened; the text names the url, the cause and what to do.
    """
    try:
        port = serial.serial_for_url(url, baudrate=baud, timeout=0, write_timeout=timeout_s)
    except (OSError, ValueError, termios.error) as error:
        raise InstrumentError(f"{url}: {_cause(error)}") from error
    if url.startswith("socket://"):
        # An option belongs to the connection, so a copy of the descriptor sets it for both.
        with socket.socket(fileno=os.dup(port.fileno())) as line:
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    elif isinstance(port, serial.Serial):
        _lower_latency(url, port)
    return SerialLink(url, port, timeout_s, terminator, accept)


def _lower_latency(url: str, port: serial.Serial) -> None:
    """Ask the adapter's driver to hand bytes over at once; an FTDI adapter else waits 16 ms."""
    try:
        port.set_low_latency_mode(True)
    except (ValueError, NotImplementedError, OSError) as error:
        _log.info("%s: no low latency mode (%s)", url, error)


def _cause(error: Exception) -> str:
    """Say what kept a port from opening, and what to do about it."""
    text = str(error)
    if "refused" in text:
        return "connection refused; is the instrument switched on, or `pincette run rig` started?"
    if "No such file" in text:
        return "no such device; is the adapter plugged in, or `pincette run rig` started?"
    if "Permission denied" in text:
        return "permission denied; may this user open serial ports (group dialout)?"
    return f"cannot be opened ({text}); check the url in the rig file"


class _Port(Protocol):
    """What is used of the several port classes of pyserial."""

    @property
    def timeout(self) -> float | None: ...
    @timeout.setter
    def timeout(self, timeout: float | None) -> None: ...
    @property
    def in_waiting(self) -> int: ...
    def fileno(self) -> int: ...
    def read(self, size: int = 1, /) -> bytes: ...
    def write(self, b: bytes, /) -> int | None: ...
    def close(self) -> None: ...


class SerialLink:
    """An open line. After a failed exchange the next one begins with an empty buffer."""

    def __init__(
        self,
        url: str,
        port: _Port,
        timeout_s: float,
        terminator: bytes,
        accept: Callable[[bytes], bool],
    ) -> None:
        self._url = url
        self._port = port
        self._timeout_s = timeout_s
        self._terminator = terminator
        self._accept = accept
        self._open = True
        try:
            self._descriptor = port.fileno()
        except io.UnsupportedOperation:
            self._descriptor = None
            port.timeout = timeout_s

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return the answer, both without their terminator.

        Raises
        ------
        InstrumentError
            Where the line is closed or hung up, or no acceptable answer came in time.
        """
        if not self._open:
            raise InstrumentError(f"{self._url}: the port is closed; open it again")
        try:
            self._drain()
            self._port.write(request + self._terminator)
            return self._answer(request)
        except serial.SerialTimeoutException as error:
            raise InstrumentError(f"{self._url}: cannot send, the line does not drain") from error
        except (OSError, termios.error) as error:
            raise InstrumentError(
                f"{self._url}: hung up ({error}); check cable and power, then open it again"
            ) from error

    def close(self) -> None:
        """Give the port back; twice is once."""
        self._open = False
        # pyserial 3.5 leaves a socket open whose peer has reset the connection.
        line: socket.socket | None = getattr(self._port, "_socket", None)
        try:
            self._port.close()
            if line is not None:
                line.close()
        except (OSError, termios.error) as error:
            _log.info("%s: closing a port that was gone (%s)", self._url, error)

    def _drain(self) -> None:
        """Drop what came late or unasked since the last exchange."""
        if self._descriptor is not None or self._port.in_waiting:
            self._receive(0.0)

    def _receive(self, wait_s: float) -> bytes:
        """Return what has arrived, waiting for its first byte; empty where none came."""
        if self._descriptor is None:
            return self._port.read(max(1, self._port.in_waiting))
        ready, _, _ = select.select([self._descriptor], [], [], wait_s)
        return self._port.read(READ_SIZE) if ready else b""

    def _answer(self, request: bytes) -> bytes:
        deadline_s = time.monotonic() + self._timeout_s
        pending = b""
        while True:
            line, found, rest = pending.partition(self._terminator)
            if found:
                if self._accept(line):
                    return line
                pending = rest
                continue
            if len(pending) > LONGEST_FRAME:
                raise InstrumentError(
                    f"{self._url}: {len(pending)} bytes without an end, limit {LONGEST_FRAME}; "
                    "check baud rate and instrument type"
                )
            left_s = deadline_s - time.monotonic()
            arrived = self._receive(left_s) if left_s > 0.0 else b""
            if not arrived:
                got = f"only {pending[:40]!r}" if pending else "no answer"
                raise InstrumentError(
                    f"{self._url}: {got} within {self._timeout_s} s to {request[:40]!r}; "
                    "check power, address and baud rate"
                )
            pending += arrived
