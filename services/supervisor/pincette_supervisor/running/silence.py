"""Who of the rig has gone silent, in words."""

from pincette.topics import LOOP
from pincette_supervisor.running.site import Site
from pincette_supervisor.running.tracker import Tracker

PROGRAMS = (*LOOP, "rig")
STALE_S, STALE_PERIODS = 1.0, 10.0
GONE_S = 1.0
"""Lockstep: how long the loop may stand still once a program's token has vanished."""


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
            silent = site.rig.program_of(tracker.silent())
            return f"{silent} is silent: no progress for {site.guard_s:g} s"
        return ""
    limit_s = max(STALE_S, STALE_PERIODS * site.rig.rig.period_s)
    if lasts_s > limit_s:
        silent = f"actuator: silent for more than {limit_s:g} s"
        return f"{killed}; {silent}" if killed else silent
    return ""
