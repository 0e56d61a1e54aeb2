"""Line to a real instrument: a serial port, a socket in its place, or a recording.

This is the only file that imports serial. A port with a descriptor never blocks (``timeout=0``);
the wait is a select, so that an answer is read as it arrives, in as few calls as it has pieces.
"""

import errno
import io
import logging
import re
import select
import socket
import termios
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

import serial

from pincette.config.instruments import NO_RFC2217
from pincette.instruments.line.arrivals import BITS_PER_BYTE, Arrivals
from pincette.instruments.line.connecting import connected
from pincette.instruments.line.counts import current_counts
from pincette.instruments.line.exclusive import (
    device_in_use,
    lock_address,
    uucp_lock,
)
from pincette.instruments.line.matching import Matching, any_line, every_line
from pincette.instruments.line.recording import Recorder, RecordingLink
from pincette.instruments.line.replay import REPLAY, ReplayLink
from pincette.instruments.line.serial_link import LONGEST_FRAME, RETRY_S, Line, Port
from pincette.instruments.line.shared_line import end_of_line
from pincette.instruments.protocols import InstrumentError, Link

__all__ = ["LONGEST_FRAME", "RETRY_S", "exchange_s", "open_link"]

QUIET_BYTES = 3
QUIET_S, QUIET_SHARE = 0.001, 0.5
"""Silence that is required after a failed exchange, in s, and upper limit of this silence as a
fraction of the timeout."""
READ_SIZE = 4096
UNSENT_PERIODS, LEAST_UNSENT_S = 4.0, 1.0
"""The system closes a connection whose other end confirms no byte for this number of exchange
timeouts, but not before this number of seconds."""
REMEDIES = {
    errno.ECONNREFUSED: (
        "connection refused; is the instrument switched on, does the device server listen at this "
        "TCP port, or is `pincette run rig` started?"
    ),
    **dict.fromkeys(
        (errno.ECONNRESET, errno.ECONNABORTED, errno.ENOTCONN, errno.EPIPE),
        "the other end has closed the connection at once; does the device server run, and has "
        "another client taken the port?",
    ),
    **dict.fromkeys(
        (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.EHOSTDOWN),
        "its host cannot be reached; is it switched on, and is the network connected?",
    ),
    errno.ENOENT: "no such device; is the adapter plugged in, or `pincette run rig` started?",
    errno.EACCES: "permission denied; may this user open serial ports (group dialout)?",
    **dict.fromkeys(
        (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS),
        "cannot be locked, so that another program could read from it at the same time; name the "
        "device itself in /dev, not on a network share or a file system without locks",
    ),
}
"""Reason and remedy of a port that cannot be opened, by the system's error number."""

NO_DEVICE = re.compile(r"(?:(?:tcp|telnet|raw|tls|http)://|socket:/?)?([^/:]+:[0-9]+)$")
"""Pattern of a TCP port written without its scheme, or with an unknown one."""
LINK_LOCAL = "socket://[fe80:"
"""Start of the url of a link-local IPv6 address (RFC 4291)."""

_log = logging.getLogger(__name__)


def _as_it_is(_link: Link) -> None:
    pass


def open_link(
    url: str,
    *,
    baud: int,
    timeout_s: float,
    terminator: bytes = b"\r",
    accept: Callable[[bytes], bool] = every_line,
    answers: Callable[[bytes], re.Pattern[bytes]] = any_line,
    probes: Sequence[bytes] = (),
    on_open: Callable[[Link], None] = _as_it_is,
    record: str | Path | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Link:
    """Open a line: ``/dev/…`` at 8N1 without flow control, ``socket://host:port``, ``replay:FILE``.

    Within ``one_line_for_each_url``, opening the same url again returns an end of the first line.

    Parameters
    ----------
    timeout_s
        Longest duration of a whole exchange, in s, including the time to open a lost port again.
    accept
        Function that returns whether a line can be an answer; other lines are skipped as
        unsolicited.
    answers
        Function that returns the pattern that every answer to a request matches; see ``Matching``.
        By default answers cannot be distinguished.
    probes
        Requests that change nothing and whose answers no other answer matches. One is sent after a
        request that was not answered in time, so that a late answer is not taken for the next one.
        Without probes the line waits for the answer, for some seconds if it never comes.
    on_open
        Function that prepares the instrument for further requests, each time that a lost port has
        been opened again, but not at the first opening. It raises InstrumentError if that is not
        possible.
    record
        File to which each exchange is written, for ``replay:``; see the module ``recording``.
    clock
        Monotonic clock, in s.

    Raises
    ------
    InstrumentError
        If the port cannot be opened; the text names the url, the cause and the remedy.
    """

    def opened(prepare: Callable[[Link], None], matching: Callable[[], Matching]) -> Link:
        return _opened(url, baud, timeout_s, terminator, matching, prepare, record, clock)

    return end_of_line(url, on_open, Matching(answers, tuple(probes), accept), opened)


def _opened(
    url: str,
    baud: int,
    timeout_s: float,
    terminator: bytes,
    matching: Callable[[], Matching],
    on_open: Callable[[Link], None],
    record: str | Path | None,
    clock: Callable[[], float],
) -> Link:
    if url.startswith(REPLAY):
        return ReplayLink(url, on_open)
    recorder = Recorder(Path(record), url, terminator, clock) if record else None
    if recorder is not None:
        on_open = recorder.opening(on_open)
    counts = current_counts()
    where = _Address()
    arrivals = Arrivals(baud) if url.startswith("socket://") else None
    try:
        link = Line(
            url=url,
            open_port=partial(_open_port, url, baud, timeout_s, where),
            timeout_s=timeout_s,
            quiet_s=max(exchange_s(QUIET_BYTES, baud), min(QUIET_S, QUIET_SHARE * timeout_s)),
            terminator=terminator,
            matching=matching,
            on_open=on_open,
            clock=clock,
            counts=counts,
            arrivals=arrivals,
        )
    except InstrumentError:
        if recorder is not None:
            recorder.close()
        raise
    if arrivals is not None:
        counts.arrivals[url] = arrivals
    return link if recorder is None else RecordingLink(link, recorder)


def exchange_s(count: int, baud: int) -> float:
    """Return the time of ``count`` bytes in s, at ten bits each: start, eight data bits, stop."""
    return count * BITS_PER_BYTE / baud


@dataclass(slots=True)
class _Address:
    """Address at which a host was first reached; ``found`` is None before that.

    A lost port is reopened at this address, since a name server that does not reply would block the
    loop for seconds.
    """

    found: tuple[str, int] | None = None


def _open_port(url: str, baud: int, timeout_s: float, where: _Address, within_s: float) -> Port:
    """Open a port exclusively, a socket within ``within_s``; raises InstrumentError."""
    if url.startswith("rfc2217://"):
        raise InstrumentError(f"{url}: {NO_RFC2217}", "cannot_open")
    try:
        if url.startswith("socket://"):
            return _SocketPort(url, where, min(timeout_s, within_s), timeout_s)
        with ExitStack() as locks:
            if url.startswith("/"):
                locks.enter_context(uucp_lock(url))
            port = serial.serial_for_url(
                url, baudrate=baud, timeout=0, write_timeout=timeout_s, exclusive=True
            )
            locks.callback(port.close)
            if isinstance(port, serial.Serial):
                _lower_latency(url, port)
            return _SerialPort(port, timeout_s, locks)
    except InstrumentError:
        raise
    except Exception as error:  # the handlers of pyserial's urls may raise any exception
        if isinstance(error, OSError) and error.errno == errno.EWOULDBLOCK:
            raise device_in_use(url) from error
        raise InstrumentError(f"{url}: {_why_closed(url, error)}", "cannot_open") from error


def _lower_latency(url: str, port: serial.Serial) -> None:
    """Request low latency from the adapter's driver; an FTDI adapter otherwise waits 16 ms."""
    try:
        port.set_low_latency_mode(True)
    except (ValueError, NotImplementedError, OSError) as error:
        _log.info("%s: no low latency mode (%s)", url, error)


def _why_closed(url: str, error: Exception) -> str:
    if isinstance(error, socket.gaierror):
        return f"its host name does not resolve ({error.strerror}); check it, or write the address"
    if isinstance(error, TimeoutError):
        return "its host does not answer; is it switched on, and is the network connected?"
    if found := NO_DEVICE.match(url):
        return f"no device and no url; for a TCP port write socket://{found[1]}"
    if isinstance(error, OSError) and error.errno == errno.EINVAL and url.startswith(LINK_LOCAL):
        return (
            "a link-local address needs its network interface, as in socket://[fe80::1%eth0]:4001"
        )
    unknown = f"cannot be opened ({type(error).__name__}: {error}); check the url in the rig file"
    # pyserial's own error has the number, or for ``socket://`` its cause.
    behind = (error, error.__context__)
    numbers = (one.errno for one in behind if isinstance(one, OSError) and one.errno is not None)
    return REMEDIES.get(next(numbers, 0), unknown)


class _AnyPort(Protocol):
    """Common interface of the port classes of pyserial that are used."""

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


class _SerialPort:
    """Port of pyserial whose errors are reduced to OSError and TimeoutError."""

    def __init__(self, port: _AnyPort, timeout_s: float, held: ExitStack) -> None:
        """Take over the port, and ``held``, which closes it and frees its locks."""
        self._port = port
        try:
            self._descriptor = port.fileno()
        except io.UnsupportedOperation:
            self._descriptor = None
            port.timeout = timeout_s
        self._held = held.pop_all()

    def write(self, data: bytes) -> None:
        with _of_one_kind():
            self._port.write(data)

    def receive(self, wait_s: float) -> bytes:
        with _of_one_kind():
            if self._descriptor is None:
                waiting = self._port.in_waiting
                return self._port.read(waiting or 1) if waiting or wait_s > 0.0 else b""
            ready, _, _ = select.select([self._descriptor], [], [], wait_s)
            return self._port.read(READ_SIZE) if ready else b""

    def close(self) -> None:
        with _of_one_kind():
            self._held.close()


@contextmanager
def _of_one_kind() -> Generator[None]:
    """Raise OSError, or TimeoutError for a write, for every error that pyserial 3.5 raises.

    A lost port may raise a termios.error, which is not an OSError; a closed port raises a TypeError
    from its descriptor.
    """
    try:
        yield
    except serial.SerialTimeoutException as error:
        raise TimeoutError(str(error)) from error
    except (termios.error, TypeError) as error:
        raise OSError(str(error)) from error


def _host_and_port(url: str) -> tuple[str, int]:
    """Return host and port of a url; raises ValueError if it does not contain them."""
    parts = urlsplit(url)
    if not parts.hostname or not parts.port:
        raise ValueError("wanted socket://HOST:PORT with a port from 1 to 65535")
    return parts.hostname.replace("%25", "%"), parts.port  # a zone may be escaped: RFC 6874


def _address_of(connected: socket.socket) -> str:
    """Return the numeric address of a socket's other end, with the zone if it is link-local."""
    return socket.getnameinfo(connected.getpeername(), socket.NI_NUMERICHOST)[0]


class _SocketPort:
    """TCP connection that sends each write at once, locked against other programs of this host.

    It replaces pyserial's own class, which waits 5 s for a host that does not answer and 0.3 s at
    each close. ``timeout_s`` bounds the connection. The first connection also resolves the host's
    name, which is not bounded.

    Raises
    ------
    InstrumentError
        If another program of this host has the instrument.
    ValueError
        If the url names no host and port.
    OSError
        If no program listens there, or not within ``timeout_s``.
    """

    def __init__(self, url: str, where: _Address, timeout_s: float, write_timeout_s: float) -> None:
        host, port = where.found or _host_and_port(url)
        # If a second client connects, many serial servers end the first connection, or mix both.
        with lock_address(url, host, port) as held:
            self._socket = held.enter_context(connected(host, port, timeout_s))
            # Each of these raises OSError if the other end has reset the connection meanwhile.
            found = _address_of(self._socket), port
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # Otherwise the system would retransmit data to a lost host for a quarter of an hour.
            most_ms = round(1000.0 * max(UNSENT_PERIODS * write_timeout_s, LEAST_UNSENT_S))
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, most_ms)
            self._socket.settimeout(write_timeout_s)
            self._held = held.pop_all()
        where.found = found

    def write(self, data: bytes) -> None:
        """Send all bytes; raises TimeoutError if the other end does not read."""
        self._socket.sendall(data)

    def receive(self, wait_s: float) -> bytes:
        """Return the bytes that have arrived, waiting for the first one; empty if none came."""
        # A device server may forward single bytes, and wait for the acknowledgement of each
        # (Nagle). Without this option, Linux delays an acknowledgement by 40 ms; it also resets the
        # option.
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        ready, _, _ = select.select([self._socket], [], [], wait_s)
        if not ready:
            return b""
        data = self._socket.recv(READ_SIZE)
        if not data:
            raise ConnectionError("the other end has closed the connection")
        return data

    def close(self) -> None:
        """End the connection and free the instrument for other programs."""
        self._held.close()
