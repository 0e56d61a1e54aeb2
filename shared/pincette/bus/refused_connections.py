"""Rejected connections to a program's ports: their number, and a limited number of log lines."""

import logging
from collections.abc import Callable
from time import monotonic

log = logging.getLogger("pincette")
LOGGED_S = 10.0
"""Shortest time between two log lines, in s, however many connections are rejected."""


class RefusedConnections:
    """Counts the connections that one thread rejected, and logs a few of them."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self.count = 0
        """Number of rejected connections since the program started."""
        self._log_s = 0.0
        """Time from which on a rejection is logged again, in s."""
        self._unlogged = 0

    def note(self, address: str, reason: str) -> None:
        """Count a rejected connection, and log it unless another one was just logged."""
        self.count += 1
        self._unlogged += 1
        now_s = self._clock()
        if now_s < self._log_s:
            return
        log.warning(
            "bus: connection of %s refused: %s (%d refused since the last such line)",
            address,
            reason,
            self._unlogged,
        )
        self._log_s, self._unlogged = now_s + LOGGED_S, 0
