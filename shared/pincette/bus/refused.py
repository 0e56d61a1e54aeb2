"""Messages from the bus that a program refused: their number, the last reason, and bounded logs."""

import logging
from collections.abc import Callable
from threading import Lock
from time import monotonic

from pincette.core.faults import Fault, FaultCode, fault

log = logging.getLogger("pincette")
LOG_EVERY_S = 10.0
"""Shortest time between two log lines, however many messages are refused."""
SHOWN_S = 60.0
"""Time for which a refusal stays a finding of its program."""


class RefusedMessages:
    """Counts the messages that one program refused, in any of its threads."""

    def __init__(self, program: str, clock: Callable[[], float] = monotonic) -> None:
        self._program, self._clock, self._lock = program, clock, Lock()
        self.count = 0
        """Number of refused messages since the program started."""
        self.reason = ""
        """Reason of the last refusal."""
        self._refused_s = self._logged_s = float("-inf")
        self._unlogged = 0

    def note(self, place: str, reason: str) -> None:
        """Count a message on the key ``place``, and log the reason unless one was just logged."""
        with self._lock:
            now_s = self._clock()
            self.count += 1
            self.reason, self._refused_s = f"{place}: {reason}", now_s
            self._unlogged += 1
            if now_s - self._logged_s < LOG_EVERY_S:
                return
            self._logged_s, unlogged, self._unlogged = now_s, self._unlogged, 0
            line = self.reason
        more = f" ({unlogged - 1} more since the last such line)" if unlogged > 1 else ""
        log.warning("%s: refused a message on %s%s", self._program, line, more)

    def finding(self) -> Fault | None:
        """Return the finding that messages are refused; None if none was for ``SHOWN_S``."""
        with self._lock:
            age_s = self._clock() - self._refused_s
            if age_s >= SHOWN_S:
                return None
            return fault(FaultCode.MESSAGES_REFUSED, self.reason, messages=self.count, age_s=age_s)
