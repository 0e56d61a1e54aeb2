"""Connections to a program's ports that were refused: their number, and bounded log lines."""

import logging
from collections.abc import Callable
from time import monotonic

log = logging.getLogger("pincette")
LOGGED_S = 10.0
"""Shortest time between two log lines, in s, however many connections are refused."""


class RefusedConnections:
    """Counts the connections that one thread refused, and logs a few of them."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self.count = 0
        """Number of refused connections since the program started."""
        self._log_s = 0.0
        """Time from which on a refusal is logged again."""
        self._unlogged = 0

    def note(self, address: str, reason: str) -> None:
        """Count a refused connection, and log it unless another one was just logged."""
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
