"""Ends a router that no longer routes, so that a new one can take its place.

A thread of Zenoh may wait forever for a lock of the routing tables that it holds itself (Zenoh
1.10.2, https://github.com/eclipse-zenoh/zenoh/pull/2619). Such a router still accepts links but
carries nothing over them, and nothing within the process helps. A router keeps no state, the links
of the loop do not use it, and its clients reconnect automatically. The process therefore ends, and
whatever started it (``pincette up``, systemd, a container engine) starts another one.
"""

import logging
import os
from collections.abc import Callable
from time import monotonic

from pincette.engine.threads import RepeatedAction

log = logging.getLogger("pincette")
CODE = "router.locked"
"""Code of the log line, also as its member ``code``."""
ENDED_STATUS = 75
"""Exit status of a router that has ended itself: EX_TEMPFAIL, a failure that a restart resolves."""
ASK_S, LOOK_S = 1.0, 0.5
LEASES = 10
"""Longest time without a reply of the watched router, as a multiple of the lease of a link: 5 s in
real time. With this value, a restarted router is ready before the supervisor's lease on a job ends,
which is 10 s by default."""


class RouterWatch:
    """Watches whether a router replies, and calls ``end`` when it has not for too long.

    Parameters
    ----------
    ask
        Function that queries the router and returns with its reply; it may never return.
    limit_s
        Longest time without a reply, in s.
    end
        Function that is called with the time without a reply, in s.
    """

    def __init__(
        self,
        ask: Callable[[], None],
        limit_s: float,
        end: Callable[[float], None],
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._ask, self._limit_s, self._end, self._clock = ask, limit_s, end, clock
        self._silent_s = 0.0
        self._looked_s = clock()
        self._asking = RepeatedAction("router-asks", ASK_S, self.ask)
        self._looking = RepeatedAction("router-watch", LOOK_S, self.look)

    def start(self) -> None:
        """Start to watch."""
        self._looked_s = self._clock()
        self._asking.start()
        self._looking.start()

    def ask(self) -> None:
        """Send the router one query."""
        self._ask()
        self._silent_s = 0.0

    def look(self) -> None:
        """Call ``end`` if the router has not replied for too long."""
        now_s = self._clock()
        # If this process did not run for a time, that says nothing about the router.
        self._silent_s += min(now_s - self._looked_s, 2.0 * LOOK_S)
        self._looked_s = now_s
        if self._silent_s > self._limit_s:
            self._end(self._silent_s)

    def close(self) -> None:
        """Stop watching; does not wait for a pending query."""
        self._looking.close(0.0)
        self._asking.close(0.0)


def end_process(silent_s: float) -> None:
    """End this process at once, without leaving the bus, after a log line with the reason."""
    log.critical(
        "%s: the router has not answered itself for %.1f s, so this process ends with "
        "status %d, to be restarted; the loop continues and a held part stays held",
        CODE,
        silent_s,
        ENDED_STATUS,
        extra={"code": CODE},
    )
    for handler in logging.getLogger().handlers:
        handler.flush()
    os._exit(ENDED_STATUS)
