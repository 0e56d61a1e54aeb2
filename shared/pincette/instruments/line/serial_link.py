"""A line that speaks in requests and answers, over any port, and opens a lost port again."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Protocol

from pincette.instruments.protocols import InstrumentError, Link

LONGEST_FRAME = 256
RETRY_S = 0.5
"""Least time from one attempt to open a lost port again to the next."""
GRACE = 0.2
"""Share of the timeout that is waited once more where it has passed: the time may have passed while
the machine stood still, with the answer on its way all along."""
UNANSWERED = 8
"""Exchanges in a row without a byte after which the port is opened anew: the other end may have
gone without a word, as over a network that was cut."""
STANDSTILL_S = 0.005
"""A deadline that is missed by more than this was missed by the machine."""

_log = logging.getLogger("pincette.instruments.link")


class Port(Protocol):
    """Bytes to and from somewhere.

    Each method raises OSError where the other end is gone, ValueError where the port itself is.
    """

    def write(self, data: bytes, /) -> None:
        """Send all of it; raises TimeoutError where the line does not drain."""
        ...

    def receive(self, wait_s: float, /) -> bytes:
        """Return what has arrived, waiting for its first byte; empty where none came."""
        ...

    def close(self) -> None:
        """Give it back."""
        ...


def escaped(data: bytes) -> str:
    """Bytes as Python escapes them, without quotes."""
    return data.decode("latin-1").encode("unicode_escape").decode("ascii")


@dataclass(slots=True)
class Line:
    """One line to an instrument.

    A port that is lost, or over which nobody has answered ``UNANSWERED`` exchanges, is opened again
    by the exchange after that, at most once each ``RETRY_S``, and ``on_open`` prepares the
    instrument before that exchange goes on; all of it within ``timeout_s``. The exchange that lost
    the port has failed, and is not sent again.
    """

    url: str
    open_port: Callable[[float], Port]
    """Opens the port within so many seconds; raises InstrumentError."""
    timeout_s: float
    """For a whole exchange."""
    quiet_s: float
    """After a failed exchange the line must be silent for so long before the next is sent, unless
    what it still owed has come."""
    terminator: bytes
    accept: Callable[[bytes], bool]
    """Whether a line can be an answer; others are skipped as unsolicited."""
    on_open: Callable[[Link], None]
    clock: Callable[[], float]
    _port: Port | None = field(default=None, init=False)
    _closed: bool = field(default=False, init=False)
    _owed: float = field(default=0, init=False)
    """Answers that may still come; infinite after bytes that were none."""
    _unanswered_count: int = field(default=0, init=False)
    _next_try_s: float = field(default=float("-inf"), init=False)
    _opening_until_s: float | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._port = self.open_port(self.timeout_s)

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return the answer, both without their terminator.

        Raises
        ------
        InstrumentError
            Where the line is closed or hung up, or no acceptable answer came in time.
        """
        reply = self._noted(request, answered=True)
        _log.debug("%s: %s -> %s", self.url, _Escaped(request), _Escaped(reply))
        return reply

    def tell(self, line: bytes) -> None:
        """Send a line that has no answer.

        Raises
        ------
        InstrumentError
            Where the line is closed or hung up, or does not drain.
        """
        self._noted(line, answered=False)
        _log.debug("%s: %s", self.url, _Escaped(line))

    def close(self) -> None:
        """Give the port back; twice is once."""
        self._closed = True
        self._drop()

    def _noted(self, line: bytes, *, answered: bool) -> bytes:
        try:
            reply = self._converse(line, answered=answered)
            self._unanswered_count *= not answered
            return reply
        except InstrumentError as error:
            if error.code == "garbled":
                self._owed = inf
            self._count(error)
            _log.debug("%s: %s -> %s: %s", self.url, _Escaped(line), error.code, error)
            raise

    def _count(self, error: InstrumentError) -> None:
        """Give a port up over which nobody answers; not while it is being opened."""
        self._unanswered_count = self._unanswered_count + 1 if error.code == "silent" else 0
        if self._unanswered_count >= UNANSWERED and self._opening_until_s is None:
            _log.warning("%s: %d exchanges unanswered; opened anew", self.url, UNANSWERED)
            self._unanswered_count = 0
            self._drop()

    def _converse(self, line: bytes, *, answered: bool) -> bytes:
        until_s = self._opening_until_s
        if until_s is None:
            until_s = self.clock() + self.timeout_s
        port = self._ready(until_s)
        try:
            if not answered:
                port.write(line + self.terminator)
                return b""
            self._drain(port, until_s)
            self._owed += 1
            port.write(line + self.terminator)
            return self._answer(port, line, until_s)
        except TimeoutError as error:
            text = f"{self.url}: cannot send, the line does not drain; is the other end deaf?"
            raise InstrumentError(text, "silent") from error
        except (OSError, ValueError) as error:
            self._drop()
            text = f"{self.url}: hung up ({error}); check cable and power, it is opened again then"
            raise InstrumentError(text, "hung_up") from error

    def _ready(self, until_s: float) -> Port:
        """Return the port, opened again where it was lost and its time has come."""
        if self._closed:
            raise InstrumentError(f"{self.url}: the port is closed; open it again", "misused")
        if self._port is not None:
            return self._port
        now_s = self.clock()
        if now_s < self._next_try_s:
            wait_s = self._next_try_s - now_s
            text = f"{self.url}: hung up; it is tried again in {wait_s:.1f} s"
            raise InstrumentError(text, "hung_up")
        self._next_try_s = now_s + RETRY_S
        try:
            self._port = self.open_port(until_s - now_s)
        except InstrumentError as error:
            text = f"{error}; it has hung up, and is tried again in {RETRY_S} s"
            raise InstrumentError(text, "hung_up") from error
        self._prepare(until_s)
        return self._port

    def _prepare(self, until_s: float) -> None:
        """Let the driver bring the instrument to where it can work on."""
        self._owed, self._opening_until_s = 0, until_s
        try:
            self.on_open(self)
        except InstrumentError as error:
            self._drop()
            text = f"{self.url}: opened again, but the instrument cannot work on: {error}"
            raise InstrumentError(text, error.code) from error
        finally:
            self._opening_until_s = None
        _log.warning("%s: opened again after it had hung up", self.url)

    def _drop(self) -> None:
        port, self._port = self._port, None
        if port is None:
            return
        try:
            port.close()
        except (OSError, ValueError) as error:
            _log.info("%s: closing a port that was gone (%s)", self.url, error)

    def _drain(self, port: Port, until_s: float) -> None:
        """Drop what came late or unasked since the last exchange."""
        pending = b""
        while data := port.receive(self.quiet_s if self._owed else 0.0):
            if self.clock() >= until_s:
                text = f"{self.url}: never silent; check baud rate and instrument type"
                raise InstrumentError(text, "garbled")
            *lines, pending = (pending + data).split(self.terminator)
            self._owed = max(0, self._owed - sum(map(self.accept, lines)))

    def _answer(self, port: Port, request: bytes, until_s: float) -> bytes:
        pending, last = b"", False
        while True:
            line, found, rest = pending.partition(self.terminator)
            if found:
                if self.accept(line):
                    self._owed = 0
                    return line
                _log.debug("%s: skipped %s", self.url, _Escaped(line))
                pending = rest
                continue
            if len(pending) > LONGEST_FRAME:
                text = (
                    f"{self.url}: {len(pending)} bytes without an end, limit {LONGEST_FRAME}; "
                    "check baud rate and instrument type"
                )
                raise InstrumentError(text, "garbled")
            left_s = until_s - self.clock()
            if left_s <= 0.0:
                if last:
                    raise self._unanswered(request, pending)
                last = True
                left_s = GRACE * self.timeout_s if left_s < -STANDSTILL_S else 0.0
                until_s = self.clock() + left_s
            pending += port.receive(left_s)

    def _unanswered(self, request: bytes, pending: bytes) -> InstrumentError:
        got = f"only {pending[:40]!r}" if pending else "no answer"
        text = (
            f"{self.url}: {got} within {self.timeout_s} s to {request[:40]!r}; "
            "check power, address and baud rate"
        )
        return InstrumentError(text, "garbled" if pending else "silent")


@dataclass(frozen=True, slots=True)
class _Escaped:
    """Bytes that are escaped only where a log is written."""

    data: bytes

    def __str__(self) -> str:
        return escaped(self.data)
