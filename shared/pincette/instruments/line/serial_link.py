"""Line of requests and answers over any port.

A reply contains no number, so the line keeps a list of open requests, which have no reply yet.
While one is open, no request is sent whose reply could be confused with its reply. First the line
sends a probe, whose answer differs from all others. An instrument answers in order, so the probe's
answer closes every earlier request, whether its answer came late or never. Without a probe the line
waits, at most ``patience_s``, and then opens the port again.
"""

import logging
import re
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

from pincette.instruments.line.arrivals import Arrivals
from pincette.instruments.line.counts import LineCounts
from pincette.instruments.line.matching import Matching
from pincette.instruments.line.open_requests import OpenRequest, OpenRequests
from pincette.instruments.protocols import ErrorCode, InstrumentError, Link

LONGEST_FRAME = 256
RETRY_S = 0.5
"""Shortest time between two attempts to open a lost port again, in s."""
GRACE = 0.2
"""Additional wait after the timeout, as a fraction of it: the machine may have stalled while the
reply was already being transmitted.
"""
PATIENCE_TIMEOUTS, LEAST_PATIENCE_S = 4.0, 2.0
"""A missing reply counts as lost after this number of timeouts, but not before this number of
seconds, if there is no probe. The port is then opened again."""
MOST_UNEXPECTED = 3
"""Number of successive exchanges with a surplus reply after which no more requests are sent."""
STANDSTILL_S = 0.005
"""Delay in s beyond a deadline above which the machine, not the instrument, counts as the cause."""
SETTLE_S, LONGEST_SETTLE_S = 0.05, 0.5
"""Silence that is awaited on a new port, and the longest time that this may take, in s. A device
server may send a banner, and the reply to an earlier client may still arrive.
"""
GREETING_SHARE = 0.25
"""Share of the exchange time for which the banner of a reopened port is awaited, if that port has
sent one before."""
LINE_END = b"\r\n"
"""Characters at the end of a banner; one of them may remain before the first answer."""
OFTEN, OFTEN_WITHIN_S = 4, 60.0
"""A second client is suspected if a port was opened again this number of times within this time in
s."""
TELNET = re.compile(rb"\xff(?:[\xfb-\xfd]|\xfe(?!.\x00))", re.DOTALL)
"""First bytes of a telnet negotiation (RFC 854): IAC and one of WILL, WONT, DO, DONT. A text in
UTF-16 also begins with IAC DONT, but every second byte of it is 0."""
TELNET_COMMAND = re.compile(rb"\xff[\xf0-\xfe]")
"""Telnet command: IAC and any command byte. A wrong baud rate may also produce these bytes."""
SAID = (
    (
        re.compile(rb"in use|busy", re.IGNORECASE),
        "another client has this port: end it, or look for it at the device server. After a "
        "failure of the network it may be this program's own earlier connection: restart the "
        "server, or let it replace an old client by a new one (ser2net: kickolduser)",
    ),
    (
        re.compile(rb"device|open", re.IGNORECASE),
        "the device server cannot open its serial device: is the adapter plugged in there?",
    ),
)
"""Remedies for the texts that a device server sends before it closes the connection: ser2net
4.3 sends "Port already in use" and "Device open failure: ..."."""

_log = logging.getLogger("pincette.instruments.link")


class Port(Protocol):
    """Source and destination of bytes.

    Each method raises OSError if the other end is lost, ValueError if the port itself is closed.
    """

    def write(self, data: bytes, /) -> None:
        """Send all bytes; raises TimeoutError if the line does not drain."""
        ...

    def receive(self, wait_s: float, /) -> bytes:
        """Return the bytes that have arrived, waiting for the first one; empty if none came."""
        ...

    def close(self) -> None:
        """Close the port."""
        ...


def escaped(data: bytes) -> str:
    """Return bytes as Python escapes them, without quotes."""
    return data.decode("latin-1").encode("unicode_escape").decode("ascii")


@dataclass(slots=True)
class Line:
    """One line to an instrument.

    The next exchange opens a lost port again, at most once each ``RETRY_S``, and ``on_open``
    prepares the instrument before that exchange continues; all of it takes at most ``timeout_s``.
    The exchange that lost the port has failed, and is not sent again.
    """

    url: str
    open_port: Callable[[float], Port]
    """Function that opens the port within a time in s; raises InstrumentError."""
    timeout_s: float
    """Longest duration of a whole exchange on an open line, in s."""
    quiet_s: float
    """Time for which the line must be silent before a request while an earlier request is open, in
    s."""
    terminator: bytes
    matching: Callable[[], Matching]
    """Function that returns the rules by which the replies of the present driver are recognised."""
    on_open: Callable[[Link], None]
    clock: Callable[[], float]
    counts: LineCounts = field(default_factory=LineCounts)
    arrivals: Arrivals | None = None
    """Object that receives the duration of each successful exchange; None at a serial port."""
    _port: Port | None = field(default=None, init=False)
    _closed: bool = field(default=False, init=False)
    _open: OpenRequests = field(init=False)
    _pending: bytes = field(default=b"", init=False)
    """Bytes received after the last complete line."""
    _arrived_s: list[float] = field(default_factory=list[float], init=False)
    """Times at which pieces of the answer to the newest request arrived, in s."""
    _unexpected_run: int = field(default=0, init=False)
    """Number of successive exchanges before which a surplus answer was found."""
    _late_run: int = field(default=0, init=False)
    """Number of late answers since the last successful exchange."""
    _late_s: float = field(default=0.0, init=False)
    """Time from a request to the newest late answer, in s."""
    _garbled: bool = field(default=False, init=False)
    """True if bytes that were not an answer arrived after the newest request."""
    _silent_until_s: float = field(default=float("-inf"), init=False)
    _next_try_s: float = field(default=float("-inf"), init=False)
    _failure: str = field(default="", init=False)
    """Reason why the newest attempt to open the port again failed; empty if it succeeded."""
    _opening_until_s: float | None = field(default=None, init=False)
    _is_new: bool = field(default=True, init=False)
    """True until the first answer after the port was opened."""
    _greeting: bytes = field(default=b"", init=False)
    """Newest bytes from a new port that were no answer, such as a banner."""
    _greets: bool = field(default=False, init=False)
    """True once a new port has sent bytes that were no answer."""
    _reopened_at_s: deque[float] = field(default_factory=lambda: deque(maxlen=OFTEN), init=False)

    def __post_init__(self) -> None:
        self._open = OpenRequests(self.counts)
        self._port = self.open_port(self.timeout_s)
        try:
            self._settle(self._port)
        except (OSError, ValueError) as error:
            self._drop()
            raise InstrumentError(self._hung_up_text(error), "cannot_open") from error
        except InstrumentError:
            self._drop()
            raise

    @property
    def patience_s(self) -> float:
        """Time after which an open request counts as lost, in s."""
        return max(PATIENCE_TIMEOUTS * self.timeout_s, LEAST_PATIENCE_S)

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return its answer, both without their terminator.

        Raises
        ------
        InstrumentError
            If the line is closed or hung up, or no answer came in time.
        """
        reply = self._noted(request, answered=True)
        _log.debug("%s: %s -> %s", self.url, _Escaped(request), _Escaped(reply))
        return reply

    def tell(self, line: bytes) -> None:
        """Send a line that has no answer.

        Raises
        ------
        InstrumentError
            If the line is closed or hung up, or does not drain.
        """
        self._noted(line, answered=False)
        _log.debug("%s: %s", self.url, _Escaped(line))

    def close(self) -> None:
        """Close the port; repeated calls do nothing."""
        self._closed = True
        self._drop()

    def _noted(self, line: bytes, *, answered: bool) -> bytes:
        try:
            return self._converse(line, answered=answered)
        except InstrumentError as error:
            _log.debug("%s: %s -> %s: %s", self.url, _Escaped(line), error.code, error)
            raise

    def _converse(self, line: bytes, *, answered: bool) -> bytes:
        until_s = self._opening_until_s
        if until_s is None:
            until_s = self.clock() + self.timeout_s
            self._give_up_overdue()
        port = self._ready(until_s)
        matching = self.matching()
        try:
            if not answered:
                port.write(line + self.terminator)
                return b""
            self._resynchronise(port, matching, line, until_s)
            reply = self._ask(port, matching, line, until_s)
        except TimeoutError as error:
            text = (
                f"{self.url}: cannot send, since the output buffer does not empty; does the "
                "other end read?"
            )
            raise InstrumentError(text, "silent") from error
        except (OSError, ValueError) as error:
            text = f"{self._hung_up_text(error)}; it is being reopened"
            self._drop()
            raise InstrumentError(text, "hung_up") from error
        if not self._open:
            self._late_run = 0
        return reply

    def _give_up_overdue(self) -> None:
        """Count open requests older than the patience as lost, and drop their port."""
        if not self._open or self.clock() - self._open.newest_sent_s < self.patience_s:
            return
        count = self._open.give_up()
        self._late_run = 0
        _log.warning(
            "%s: %d requests unanswered for %g s; the port is being reopened",
            self.url,
            count,
            self.patience_s,
        )
        self._drop()

    def _ready(self, until_s: float) -> Port:
        """Return the port; open it again if it was lost and the retry time has passed."""
        if self._closed:
            raise InstrumentError(f"{self.url}: the port is closed; open it again", "misused")
        now_s = self.clock()
        if now_s < self._silent_until_s:
            raise self._doubled(self._silent_until_s - now_s)
        if self._port is not None:
            return self._port
        if now_s < self._next_try_s:
            wait_s = self._next_try_s - now_s
            text = f"{self.url}: the connection was closed; next attempt in {wait_s:.1f} s"
            if self._failure:
                text += f". The newest attempt failed: {self._failure}"
            raise InstrumentError(text, "hung_up")
        self._next_try_s = now_s + RETRY_S
        try:
            self._port = self.open_port(until_s - now_s)
        except InstrumentError as error:
            self._failure = str(error)
            text = f"{error}; the connection was closed; next attempt in {RETRY_S} s"
            raise InstrumentError(text, "hung_up") from error
        self._is_new, self._greeting = True, b""
        if self._greets:
            self._take_greeting(self._port, until_s)
        if self.arrivals is not None:
            self.arrivals.clear()
        self._prepare(until_s)
        return self._port

    def _settle(self, port: Port) -> None:
        """Drop unsolicited bytes from a new port; raises InstrumentError for a telnet port."""
        until_s = self.clock() + LONGEST_SETTLE_S
        while self.clock() < until_s and (data := port.receive(SETTLE_S)):
            self._note_greeting(data)

    def _take_greeting(self, port: Port, until_s: float) -> None:
        """Drop the banner of a reopened port; the exchange sees later bytes."""
        try:
            data = port.receive(max(0.0, GREETING_SHARE * (until_s - self.clock())))
        except (OSError, ValueError) as error:
            text = f"{self._hung_up_text(error)}; next attempt in {RETRY_S} s"
            self._drop()
            self._failure = text
            raise InstrumentError(text, "hung_up") from error
        if data:
            self._note_greeting(data)

    def _note_greeting(self, data: bytes) -> None:
        """Keep bytes from a new port that are not a reply; raises InstrumentError for telnet."""
        self._greets = True
        self._greeting = (self._greeting + data)[-LONGEST_FRAME:]
        if TELNET.search(self._greeting):
            self._drop()
            text = (
                f"{self.url}: sends telnet commands, so it is a telnet port; configure a raw TCP "
                "port at the device server (in ser2net: accepter: tcp,PORT)"
            )
            raise InstrumentError(text, "cannot_open")

    def _hung_up_text(self, error: Exception) -> str:
        """Return the reason for the lost port: the last text of the other end, or where to look."""
        said = (self._greeting + self._pending).strip() if self._is_new else b""
        if said:
            remedies = (remedy for pattern, remedy in SAID if pattern.search(said))
            remedy = next(remedies, "see the manual of the device server")
            text = (
                f"{self.url}: the other end sent {escaped(said)!r} and closed the "
                f"connection; {remedy}"
            )
        else:
            remedy = "check cable and power"
            if isinstance(error, ConnectionError):
                remedy = (
                    "does the device server run, has another client taken the port, and "
                    "does the server have an idle timeout?"
                )
            text = f"{self.url}: the connection was closed ({error}); {remedy}"
        times_s = self._reopened_at_s
        if len(times_s) == OFTEN and self.clock() - times_s[0] <= OFTEN_WITHIN_S:
            text += (
                f"; reopened {OFTEN} times within {self.clock() - times_s[0]:.0f} s: does "
                "another program use this port?"
            )
        return text

    def _prepare(self, until_s: float) -> None:
        """Let the driver prepare the instrument after the port was opened again."""
        self._opening_until_s = until_s
        try:
            self.on_open(self)
        except InstrumentError as error:
            self._drop()
            self._failure = str(error)
            text = f"{self.url}: reopened, but the instrument cannot continue: {error}"
            raise InstrumentError(text, error.code) from error
        finally:
            self._opening_until_s = None
        self._failure = ""
        self.counts.reopened += 1
        self._reopened_at_s.append(self.clock())
        _log.warning("%s: reopened after the connection was closed", self.url)

    def _drop(self) -> None:
        port, self._port = self._port, None
        self._pending = b""
        if port is None:
            return
        try:
            port.close()
        except (OSError, ValueError) as error:
            _log.info("%s: closing a port that no longer existed (%s)", self.url, error)

    def _resynchronise(
        self, port: Port, matching: Matching, request: bytes, until_s: float
    ) -> None:
        """Wait until there is no open request whose reply could be mistaken for the reply to this
        request.
        """
        wanted = matching.answers(request)
        in_doubt = self._drain(port, wanted, until_s)
        while True:
            other = self._open.like(wanted)
            if other is None and not (in_doubt and matching.probes):
                return
            asked = matching if other is None else other.matching
            free = (one for one in asked.probes if self._open.like(asked.answers(one)) is None)
            probe = next(free, None)
            if probe is not None:
                self._ask(port, asked, probe, until_s, probing=True)
                in_doubt = False
            elif other is None:
                return
            else:
                self._wait_for(port, other, request, until_s)
                # On a line that duplicates replies, a second one will arrive.
                in_doubt = self._drain(port, wanted, until_s, self.quiet_s)

    def _drain(
        self, port: Port, wanted: re.Pattern[bytes], until_s: float, quiet_s: float = 0.0
    ) -> bool:
        """Close open requests that have been answered, and drop all other lines.

        Returns whether a dropped line looks like a reply to the next request: in that case the line
        may duplicate replies.
        """
        unexpected = False
        while True:
            *lines, self._pending = self._pending.split(self.terminator)
            for line in filter(self.matching().accept, lines):
                if found := self._open.take(line):
                    self._note_late(found)
                else:
                    self.counts.unexpected += 1
                    if self._is_new:
                        self._note_greeting(line + self.terminator)
                    unexpected = unexpected or wanted.fullmatch(line) is not None
                    _log.debug("%s: unexpected %s", self.url, _Escaped(line))
            wait_s = self.quiet_s if self._open else quiet_s
            data = port.receive(max(0.0, min(wait_s, until_s - self.clock())))
            if not data:
                break
            if self.clock() >= until_s:
                text = f"{self.url}: data without a pause; check baud rate and instrument type"
                raise InstrumentError(text, "garbled")
            self._pending += data
        # Discard the rest of a truncated line, which would be mistaken for the start of the next
        # line.
        self._pending = b""
        self._unexpected_run = self._unexpected_run + 1 if unexpected else 0
        if self._unexpected_run >= MOST_UNEXPECTED:
            self._unexpected_run = 0
            self._silent_until_s = self.clock() + self.patience_s
            self._drop()
            raise self._doubled(self.patience_s)
        return unexpected

    def _ask(
        self,
        port: Port,
        matching: Matching,
        request: bytes,
        until_s: float,
        *,
        probing: bool = False,
    ) -> bytes:
        """Send a request and return its answer.

        If only this request is open, a line that does not match it is returned, too, so that the
        driver can check it. The request then stays open, since its reply may still arrive. For a
        probe, and for the first request at a new port, such a line is dropped, since it may be the
        reply to an earlier request or client.
        """
        own = self._open.add(matching, request, self.clock())
        self._garbled = False
        self._arrived_s.clear()
        alone = self._open.is_alone(own) and not self._pending
        port.write(request + self.terminator)
        for line in self._lines(port, until_s):
            found = self._open.take(line)
            if found is own:
                self._is_new = False
                if alone and self.arrivals is not None:
                    self._note_arrival(self.arrivals, own, len(request), len(line))
                return line
            if found is not None:
                self._note_late(found)
            elif self._open.repeats(line):
                self.counts.unexpected += 1
                _log.debug("%s: repeated %s", self.url, _Escaped(line))
            elif self._open.is_alone(own) and not probing and not self._is_new:
                self._garbled = True
                return line
            else:
                self._garbled = True
                if self._is_new:
                    self._note_greeting(line + self.terminator)
                _log.debug("%s: dropped %s", self.url, _Escaped(line))
        raise self._unanswered(request)

    def _wait_for(self, port: Port, other: OpenRequest, request: bytes, until_s: float) -> None:
        """Wait until an open request is answered; raises InstrumentError if it is not."""
        for line in self._lines(port, until_s):
            found = self._open.take(line)
            if found is not None:
                self._note_late(found)
            if found is other:
                return
        text = (
            f"{self.url}: {request[:40]!r} is not sent, since the answer to a request "
            f"{self.clock() - other.sent_s:.3f} s ago may still come; after "
            f"{self.patience_s:g} s of silence the port is reopened{self._late_words()}"
        )
        raise InstrumentError(text, self._code())

    def _lines(self, port: Port, until_s: float) -> Iterator[bytes]:
        """Yield complete solicited lines until the deadline; the rest stays pending."""
        accept, last = self.matching().accept, False
        while True:
            if self._is_new:
                self._pending = self._pending.lstrip(LINE_END)
            line, found, rest = self._pending.partition(self.terminator)
            if found:
                self._pending = rest
                if accept(line):
                    yield line
                else:
                    _log.debug("%s: skipped %s", self.url, _Escaped(line))
                continue
            if len(self._pending) > LONGEST_FRAME:
                text = (
                    f"{self.url}: {len(self._pending)} bytes without an end mark, limit "
                    f"{LONGEST_FRAME}; check baud rate and instrument type"
                )
                self._pending = b""
                raise InstrumentError(text, "garbled")
            left_s = until_s - self.clock()
            if left_s <= 0.0:
                if last:
                    return
                last = True
                left_s = GRACE * self.timeout_s if left_s < -STANDSTILL_S else 0.0
                until_s = self.clock() + left_s
            data = port.receive(left_s)
            if data and self.arrivals is not None:
                self._arrived_s.append(self.clock())
            self._pending += data

    def _note_arrival(
        self, arrivals: Arrivals, request: OpenRequest, sent: int, received: int
    ) -> None:
        """Add a successful exchange to the arrival times."""
        if self._arrived_s:
            ends = len(self.terminator)
            arrivals.add(sent + ends, received + ends, request.sent_s, self._arrived_s)

    def _note_late(self, request: OpenRequest) -> None:
        self.counts.late += 1
        self._late_run += 1
        self._late_s = self.clock() - request.sent_s
        _log.debug("%s: an answer came %.3f s after its request", self.url, self._late_s)

    def _code(self) -> ErrorCode:
        """Return the error code for a missing reply, based on the bytes that arrived instead."""
        if self._late_run:
            return "late"
        return "garbled" if self._garbled else "silent"

    def _late_words(self) -> str:
        if not self._late_run:
            return ""
        return (
            f"; {self._late_run} answers came late, the last {self._late_s:.3f} s after its "
            f"request, limit {self.timeout_s:g} s: find what delays the line, or raise "
            "timeout_s if the control period leaves time for it"
        )

    def _unanswered(self, request: bytes) -> InstrumentError:
        other = (self._greeting if self._is_new else b"") + self._pending
        got = f"only {other[-40:]!r}" if other else "no answer"
        text = f"{self.url}: {got} within {self.timeout_s} s to {request[:40]!r}"
        if self._late_run:
            return InstrumentError(f"{text}{self._late_words()}", "late")
        self._garbled = self._garbled or bool(self._pending)
        remedy = "check power, address and baud rate"
        if TELNET_COMMAND.search(other):
            remedy += ", and whether the device server has a telnet port here instead of a raw one"
        return InstrumentError(f"{text}; {remedy}", self._code())

    def _doubled(self, wait_s: float) -> InstrumentError:
        text = (
            f"{self.url}: {MOST_UNEXPECTED} exchanges in a row had more answers than "
            "requests, so answers cannot be assigned to requests; the port is reopened "
            f"after {wait_s:.1f} s of silence. Does an adapter or a second program repeat "
            "lines?"
        )
        return InstrumentError(text, "garbled")


@dataclass(frozen=True, slots=True)
class _Escaped:
    """Bytes that are escaped only when a log line is written."""

    data: bytes

    def __str__(self) -> str:
        return escaped(self.data)
