"""Delivery of a session's messages in separate threads, so that a slow consumer stalls no link.

By default Zenoh queues 256 samples for a callback, and then its network thread waits for the
callback. A process has two of these threads for all its sessions. Two hanging callbacks thus
blocked every session of the process, even one that was opened to stop the rig. Here the oldest
sample is dropped instead: the sample numbers show what is missing, and the newest sample matters
most.
"""

import logging
import threading
from collections.abc import Callable, Iterable
from time import monotonic
from typing import Any, TypeVar, cast

import zenoh

T = TypeVar("T")
WAITING = 16_384
"""Largest number of deliveries that wait for one subscriber; 15 s at 1 kHz."""
log = logging.getLogger("pincette")


def ring() -> Any:
    """Return a handler for ``declare_…`` that queues the newest deliveries and never blocks."""
    return cast("Any", zenoh.handlers.RingChannel(WAITING))


def deliver_each(source: Iterable[T], sink: Callable[[T], object], name: str) -> None:
    """Pass all deliveries of a subscriber on, in a thread that ends with the subscriber."""

    def run() -> None:
        for one in source:
            try:
                sink(one)
            except Exception:  # the next one may be valid
                log.exception("%s: a delivery failed", name)

    threading.Thread(target=run, name=f"bus {name}").start()


class RateLimit:
    """Limits the rate at which a subscriber reads messages; short bursts are allowed."""

    def __init__(self, rate_hz: float, clock: Callable[[], float] = monotonic) -> None:
        self.rate_hz, self._clock = rate_hz, clock
        self._free, self._at_s = rate_hz, clock()

    def allows(self) -> bool:
        """Return whether the next message may be read, and count it."""
        now_s = self._clock()
        self._free = min(self.rate_hz, self._free + (now_s - self._at_s) * self.rate_hz)
        self._at_s = now_s
        if self._free < 1.0:
            return False
        self._free -= 1.0
        return True
