"""Arrival times of replies over TCP, and the properties of the device server that they reveal.

If a server forwards at once, the bytes arrive one after the other, as the serial line carries them.
With ser2net's ``chardelay``, called packing time or inter-character time in other device servers,
the server buffers the bytes until the line has been silent for a time. A reply then arrives as a
whole, and later by that time. ser2net 4.3 waits for two characters at 9600 baud at any rate of the
line, rounded up to whole milliseconds: 3 ms.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median

BITS_PER_BYTE = 10
RATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)
"""Usual baud rates; the rate of a slow line is one of them."""
LEAST_ANSWERS = 5
"""Smallest number of replies of one length needed for an estimate."""
LEAST_BYTES = 8
"""Smallest length of a reply whose arrival in pieces can be detected at any baud rate."""
CLOSE_S, MANY = 0.0015, 4
"""Limits that show that an answer arrived in pieces: two pieces less than ``CLOSE_S`` s apart, or
at least ``MANY`` pieces. A server that holds answers back may divide an answer in two if the
instrument pauses within it."""
WHOLE_SHARE = 0.75
"""A server counts as holding answers back if at least this fraction of them arrives whole. Some
answers that were sent in pieces are read whole, too, if the machine is busy."""
LEAST_HELD_S = 0.001
"""Shortest time in s for which ser2net holds answers back; shorter delays come from the network."""
SLOWER = 1.5
"""Smallest ratio of the estimated to the stated time of a byte at which a line counts as slow.
Adjacent usual rates differ by at least this factor."""
MOST_KINDS, KEPT = 16, 40
"""Largest number of kinds of exchanges (by their lengths), and of newest durations kept for each.
"""
SHORT_SHARE = 0.1
"""Quantile of the durations that is used as the shortest one. The minimum itself may be wrong,
since a server that was not scheduled forwards some replies early."""


@dataclass(frozen=True, slots=True)
class Hop:
    """Properties of the device server between host and instrument, estimated from the arrival of
    replies.
    """

    held_s: float = 0.0
    """Time for which the server holds answers back, in s; 0 if they arrive byte by byte. It
    includes the extra time of a line that is slower than stated."""
    line_baud: int = 0
    """Estimated baud rate of the serial line if answers arrive byte by byte and the line is slower
    than stated; 0 otherwise."""


@dataclass(slots=True)
class _Kind:
    """Exchanges with equal lengths of request and answer."""

    count: int = 0
    whole: int = 0
    """Number of answers that arrived whole."""
    took_s: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))
    """Durations of the newest exchanges, in s."""
    spread_s: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))
    """Times from the first to the last byte of the newest answers that arrived in pieces, in s."""

    @property
    def is_held(self) -> bool:
        """True if nearly all answers arrived in one piece."""
        return self.whole >= WHOLE_SHARE * self.count

    @property
    def short_s(self) -> float:
        """Duration of an exchange that nothing else on the machine delayed, in s."""
        return sorted(self.took_s)[int(SHORT_SHARE * len(self.took_s))]


@dataclass(slots=True)
class Arrivals:
    """Durations of the exchanges over one connection, by the numbers of bytes."""

    baud: int
    """Baud rate of the line as the rig file states it."""
    _kinds: dict[tuple[int, int], _Kind] = field(default_factory=dict[tuple[int, int], _Kind])

    def clear(self) -> None:
        """Discard all durations, for a new connection."""
        self._kinds.clear()

    def add(self, sent: int, received: int, sent_s: float, arrived_s: Sequence[float]) -> None:
        """Add the times of an exchange.

        Parameters
        ----------
        sent, received
            Bytes of request and answer.
        sent_s
            Time of the request, in s.
        arrived_s
            Times at which the pieces of the answer arrived, in s; at least one.
        """
        kind = self._kinds.get((sent, received))
        if kind is None:
            if len(self._kinds) >= MOST_KINDS:
                return
            kind = self._kinds[sent, received] = _Kind()
        kind.count += 1
        kind.took_s.append(arrived_s[-1] - sent_s)
        close = any(after - before < CLOSE_S for before, after in pairwise(arrived_s))
        if close or len(arrived_s) >= MANY:
            kind.spread_s.append(arrived_s[-1] - arrived_s[0])
        else:
            kind.whole += 1

    def hop(self) -> Hop:
        """Return the estimate from the longest answers.

        Returns an empty ``Hop`` while there are too few.
        """
        enough = [
            lengths
            for lengths, kind in self._kinds.items()
            if kind.count >= LEAST_ANSWERS and lengths[1] >= LEAST_BYTES
        ]
        if not enough:
            return Hop()
        sent, received = max(enough, key=lambda lengths: lengths[1])
        kind = self._kinds[sent, received]
        if not kind.is_held:
            return Hop(line_baud=self._slower(median(kind.spread_s) / (received - 1)))
        held_s = kind.short_s - (sent + received) * BITS_PER_BYTE / self.baud
        return Hop(held_s if held_s >= LEAST_HELD_S else 0.0)

    def _slower(self, byte_s: float) -> int:
        """Return the usual baud rate nearest to the rate of a line with this time of a byte.

        Returns 0 if it is not below the stated one.
        """
        if byte_s < SLOWER * BITS_PER_BYTE / self.baud:
            return 0
        wanted = BITS_PER_BYTE / byte_s
        nearest = min(RATES, key=lambda rate: max(rate / wanted, wanted / rate))
        return nearest if nearest < self.baud else 0
