"""Restarts a supervisor that runs and that the bus does not carry any more.

A link may come up and carry nothing. Whatever the cause is, a new process has helped where nothing
within the old one did. The loop goes on meanwhile, and a held part stays held.
"""

import logging
import os
import sys
from collections.abc import Callable
from time import monotonic

from pincette.bus.protocol import BusError
from pincette.engine.program import OpenBus
from pincette.engine.threads import RepeatedAction
from pincette_supervisor.rigs.rig_context import RigContext

log = logging.getLogger("pincette")
UNHEARD_S = 30.0
"""Time without hearing itself on the bus after which the supervisor is restarted."""
ASK_S = 1.0
CAUSE = "supervisor.unheard"
RESTARTS = "PINCETTE_UNHEARD_RESTARTS"
"""Environment variable: how often the supervisor has restarted itself since it was last heard."""
MOST_DOUBLED = 4
"""Largest number of doublings of the time: a bus that stays silent costs a restart each 8 minutes.
"""


class UnheardWatch:
    """Watches whether the supervisor hears itself, and restarts it if it has not for too long.

    It is restarted only if a new session can be opened: without a router, or with one that hangs,
    a new process could not start either, and the stop by the direct link would be gone with this
    one.
    """

    def __init__(
        self,
        hears: Callable[[], bool],
        can_join: Callable[[], bool],
        restart: Callable[[float], None],
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._hears, self._can_join, self._restart = hears, can_join, restart
        self._clock = clock
        self._heard_s = clock()
        # A question to a bus that carries nothing may never come back, so the watch has its own
        # thread.
        self._asking = RepeatedAction("unheard-asks", ASK_S, self.ask)
        self._looking = RepeatedAction("unheard", ASK_S, self.look)

    def start(self) -> None:
        """Watch from here on."""
        self._heard_s = self._clock()
        self._asking.start()
        self._looking.start()

    def ask(self) -> None:
        """Ask the bus once."""
        if self._hears():
            self._heard_s = self._clock()
            os.environ.pop(RESTARTS, None)

    def look(self) -> None:
        """Restart the supervisor if it has not heard itself for too long and can join again."""
        silent_s = self._clock() - self._heard_s
        if silent_s > UNHEARD_S * 2 ** min(_restarts(), MOST_DOUBLED) and self._can_join():
            self._restart(silent_s)

    def close(self) -> None:
        """Watch no longer; waits for no question that is under way."""
        self._looking.close(0.0)
        self._asking.close(0.0)


def can_join(open_bus: OpenBus) -> bool:
    """Return whether a new session can be opened at the router."""
    try:
        open_bus().close()
    except BusError:
        return False
    return True


def restart(context: RigContext, silent_s: float) -> None:
    """Put a new process in the place of this one, with an alarm in the journal that says so.

    While the journal's disk hangs, this does nothing: a process whose threads wait for a disk
    cannot end, and the new one could not open its journal.
    """
    words = (
        f"the supervisor has not heard itself on the bus for {silent_s:.0f} s, limit "
        f"{UNHEARD_S:g} s, although the router takes new links: it restarts itself; the loop and "
        "a held part go on"
    )
    context.alarms.raise_alarm(CAUSE, words, severity="alarm", clears="acknowledge")
    if context.write_queue.late:
        return
    log.critical("%s", words)
    for handler in logging.getLogger().handlers:
        handler.flush()
    os.environ[RESTARTS] = str(_restarts() + 1)
    # All other descriptors are closed by this, and with them the links that carry nothing.
    os.execv(sys.executable, sys.orig_argv)


def _restarts() -> int:
    text = os.environ.get(RESTARTS, "")
    return int(text) if text.isdecimal() else 0
