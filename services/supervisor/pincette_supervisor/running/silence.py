"""Who of the rig has gone silent, in words."""

from pincette.topics import APPLIED, LOOP
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


def silent_words(site: Site, tracker: Tracker, heard_at: float, asked_at: float) -> str:
    """Who has gone silent, in words; empty where nobody has.

    In lockstep the whole loop stands still when one program does; in real time the actuator
    speaks for the loop, since it notices by itself when the others are silent.
    """
    killed = gone_words(site)
    if site.rig.lockstep:
        stood_s = site.clock() - max(heard_at, asked_at)
        if killed and stood_s > min(GONE_S, site.guard_s):
            return killed
        if stood_s > site.guard_s:
            return f"{tracker.silent()} is silent: no progress for {site.guard_s:g} s"
        return ""
    limit_s = max(STALE_S, STALE_PERIODS * site.rig.rig.period_s)
    age_s = site.observer.age_s(APPLIED)
    if (age_s is None or age_s > limit_s) and site.clock() - asked_at > limit_s:
        silent = f"actuator: silent for more than {limit_s:g} s"
        return f"{killed}; {silent}" if killed else silent
    return ""
