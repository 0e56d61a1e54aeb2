"""Arrival times of answers over TCP, and what they say about the device server in between.

A server that forwards at once lets the bytes arrive one after the other, as the serial line carries
them. ser2net's ``chardelay``, and what boxes call packing time or inter-character time, holds them
back until the line has been silent for a time, so that an answer arrives whole, and later by that
time. ser2net 4.3 waits for two characters at 9600 baud whatever the rate of the line is, rounded up
to whole milliseconds: 3 ms.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median

BITS_PER_BYTE = 10
RATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)
"""Usual baud rates, of which the rate of a slow line is one."""
LEAST_ANSWERS = 5
"""Answers of one length before anything is said."""
LEAST_BYTES = 8
"""Length of an answer whose arrival in pieces can be seen at any rate."""
CLOSE_S, MANY = 0.0015, 4
"""Time between two pieces of an answer that no server leaves that holds answers back, and number of
pieces that it does not cut an answer into. It cuts some in two where the instrument hesitates."""
WHOLE_SHARE = 0.75
"""Least share of answers that arrive whole from a server that holds them back. A busy machine reads
some answers whole that were sent in pieces."""
LEAST_HELD_S = 0.001
"""Shortest time for which ser2net holds answers back; what is shorter is the network."""
SLOWER = 1.5
"""Factor between the stated and the estimated time of a byte from which a line is slow. The usual
rates differ by at least as much."""
MOST_KINDS, KEPT = 16, 40
"""Kinds of exchanges that are kept, by their lengths, and the newest durations of each."""
SHORT_SHARE = 0.1
"""Share of the durations that are shorter than the one that counts. The shortest of all may be
wrong, since a server that was not run forwards some answers early."""


@dataclass(frozen=True, slots=True)
class Hop:
    """What the arrival of answers says of the device server in between."""

    held_s: float = 0.0
    """Time for which the server holds answers back, in s; 0 where they arrive byte by byte. It
    includes what a line that is slower than stated takes longer."""
    line_baud: int = 0
    """Estimated rate of the serial line where answers arrive byte by byte and it is slower than
    stated; 0 otherwise."""


@dataclass(slots=True)
class _Kind:
    """Exchanges of one length."""

    count: int = 0
    whole: int = 0
    """Answers that arrived whole."""
    took_s: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))
    """Durations of the newest exchanges."""
    spread_s: deque[float] = field(default_factory=lambda: deque(maxlen=KEPT))
    """Times from the first to the last byte of the newest answers that arrived in pieces."""

    @property
    def is_held(self) -> bool:
        """True if nearly all answers arrived in one piece."""
        return self.whole >= WHOLE_SHARE * self.count

    @property
    def short_s(self) -> float:
        """Duration of an exchange that nothing else on the machine delayed."""
        return sorted(self.took_s)[int(SHORT_SHARE * len(self.took_s))]


@dataclass(slots=True)
class Arrivals:
    """Durations of the exchanges over one connection, by the number of bytes."""

    baud: int
    """Rate of the line as the rig file states it."""
    _kinds: dict[tuple[int, int], _Kind] = field(default_factory=dict[tuple[int, int], _Kind])

    def clear(self) -> None:
        """Forget everything, for a new connection."""
        self._kinds.clear()

    def add(self, sent: int, received: int, sent_s: float, arrived_s: Sequence[float]) -> None:
        """Add an exchange.

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
        """Return what the exchanges of the longest answers say; nothing before there are enough."""
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
        """Return the usual rate next to a time of a byte; 0 if it is not below the stated one."""
        if byte_s < SLOWER * BITS_PER_BYTE / self.baud:
            return 0
        wanted = BITS_PER_BYTE / byte_s
        nearest = min(RATES, key=lambda rate: max(rate / wanted, wanted / rate))
        return nearest if nearest < self.baud else 0
