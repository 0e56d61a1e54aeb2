"""Who of the rig has gone silent, in words."""

from collections.abc import Callable

from pincette.topics import LOOP
from pincette_supervisor.running.site import Site
from pincette_supervisor.running.tracker import Tracker

PROGRAMS = (*LOOP, "rig")
STALE_S, STALE_PERIODS = 1.0, 10.0
GONE_S = 1.0
"""Lockstep: how long the loop may stand still once a program's token has vanished."""
LOOK_COUNTS_S = 0.1
"""The most that one look counts for; several times what there is between two of them."""


class Silence:
    """How long the rig has said nothing, as far as this program was there to hear it.

    One that was stopped, or that a busy machine did not run, finds everybody silent when it wakes,
    and hears in its next moments what was said meanwhile.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._looked_at = clock, clock()
        self.lasts_s = 0.0

    def look(self, *, heard: bool) -> None:
        """Look once more; ``heard``: the rig has said something since the last look."""
        now = self._clock()
        self.lasts_s = 0.0 if heard else self.lasts_s + min(now - self._looked_at, LOOK_COUNTS_S)
        self._looked_at = now


def gone_words(site: Site) -> str:
    """Programs whose token has vanished, in words."""
    gone = site.observer.gone(PROGRAMS)
    return f"killed or hung: {', '.join(gone)}" if gone else ""


def silent_words(site: Site, tracker: Tracker, lasts_s: float) -> str:
    """Who has gone silent, in words; empty where nobody has.

    In lockstep the whole loop stands still when one program does; in real time the actuator
    speaks for the loop, since it notices by itself when the others are silent.
    """
    killed = gone_words(site)
    if site.rig.lockstep:
        if killed and lasts_s > min(GONE_S, site.guard_s):
            return killed
        if lasts_s > site.guard_s:
            return f"{tracker.silent()} is silent: no progress for {site.guard_s:g} s"
        return ""
    limit_s = max(STALE_S, STALE_PERIODS * site.rig.rig.period_s)
    if lasts_s > limit_s:
        silent = f"actuator: silent for more than {limit_s:g} s"
        return f"{killed}; {silent}" if killed else silent
    return ""
