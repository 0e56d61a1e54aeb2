"""Rejected messages from the bus: their number, the last reason, and a limited number of log
lines.
"""

import logging
from collections import deque
from collections.abc import Callable
from threading import Lock
from time import monotonic

from pincette.core.faults import Fault, FaultCode, fault

log = logging.getLogger("pincette")
LOG_EVERY_S = 10.0
"""Shortest time between two log lines, in s, however many messages are rejected."""
SHOWN_S = 60.0
"""Time for which a rejected message is reported as a finding of its program, in s."""
MANY, MANY_WITHIN_S = 5, 10.0
"""Number of rejected samples, and period in s. A finding reports a topic if this many of its
samples are rejected for their sequence numbers within the period. The bus itself may repeat or
reorder a few samples."""


class RefusedMessages:
    """Counts the messages that one program rejected, in any of its threads."""

    def __init__(self, program: str, clock: Callable[[], float] = monotonic) -> None:
        self._program, self._clock, self._lock = program, clock, Lock()
        self.count = 0
        """Number of rejected messages since the program started, without those noted with
        ``also``.
        """
        self._also = 0
        self.reason = ""
        """Key of the last rejected message, and the reason."""
        self.last = "", ""
        """Key and reason of the last rejected message, as two texts."""
        self._refused_s = self._logged_s = float("-inf")
        self._unlogged = 0

    def note(self, place: str, reason: str, *, also: bool = False) -> None:
        """Count a rejected message on the key ``place``, and log the reason unless one was just
        logged.

        ``also``: True if the caller also counts the message in a separate number.
        """
        with self._lock:
            now_s = self._clock()
            if also:
                self._also += 1
            else:
                self.count += 1
            self.reason, self._refused_s = f"{place}: {reason}", now_s
            self.last = place, reason
            self._unlogged += 1
            if now_s - self._logged_s < LOG_EVERY_S:
                return
            self._logged_s, unlogged, self._unlogged = now_s, self._unlogged, 0
            line = self.reason
        more = f" ({unlogged - 1} more since the last such line)" if unlogged > 1 else ""
        log.warning("%s: refused a message on %s%s", self._program, line, more)

    def finding(self) -> Fault | None:
        """Return the finding that messages are rejected; None if none was rejected within
        ``SHOWN_S``.
        """
        with self._lock:
            age_s = self._clock() - self._refused_s
            if age_s >= SHOWN_S:
                return None
            messages = self.count + self._also
            return fault(FaultCode.MESSAGES_REFUSED, self.reason, messages=messages, age_s=age_s)


class RefusedNumbers:
    """Reports samples that a program rejected for their sequence numbers, if there are many."""

    def __init__(self, refused: RefusedMessages, clock: Callable[[], float] = monotonic) -> None:
        """``refused``: object that receives the report."""
        self._refused, self._clock = refused, clock
        self._times_s: dict[str, deque[float]] = {}
        """Times of the newest rejections, in s, by topic."""

    def note(self, topic: str, producer: str, seq: int) -> None:
        """Note a rejected sample of a topic; programs other than ``producer`` may publish the
        topic, too.
        """
        times_s = self._times_s.setdefault(topic, deque(maxlen=MANY))
        times_s.append(self._clock())
        if len(times_s) == MANY and times_s[-1] - times_s[0] <= MANY_WITHIN_S:
            reason = (
                f"{MANY} samples within {MANY_WITHIN_S:g} s had numbers that were used "
                f"already or lie ahead, the last was {seq}: another program than the "
                f"{producer} publishes them"
            )
            self._refused.note(topic, reason, also=True)
