"""Who goes first on one machine: the loop, then the system, then what plans, draws and records.

Wishes, not needs, unless the rig file says so: where one is not permitted the program runs without
it, and says so once. To be asked before the bus is joined, since only threads that begin afterwards
inherit the answer.
"""

import logging
import os
import sys
from contextlib import suppress

from pincette.config.realtime import PRIORITY, Wishes
from pincette.config.tables import ConfigError
from pincette.runtime.realtime.asking import ask, words
from pincette.runtime.realtime.system import Linux, System

log = logging.getLogger(__name__)
FIFO = PRIORITY
LAST = 10
"""Niceness."""
_ANY = Wishes()


def come_first(wishes: Wishes = _ANY, system: System | None = None) -> None:
    """Ask to run before plots, tests and browsers.

    A fair scheduler lets a thread that wakes up wait for the slices of others, a few ms each; a
    tick has a dozen such waits one after another. So a fixed priority is asked for first.

    Raises
    ------
    ConfigError
        Where something is not permitted that the rig file requires.
    """
    if system is None and sys.platform != "linux":
        if wishes.required:
            raise ConfigError(f"[realtime] required = {_named(wishes)}: it takes Linux")
        return
    refusals = ask(wishes, Linux() if system is None else system)
    if not refusals:
        return
    needed = [one for one in refusals if one.wish in wishes.required]
    if needed:
        raise ConfigError(
            f"[realtime] required = {_named(wishes)}: does not run without {words(tuple(needed))}"
        )
    log.info("runs without %s", words(refusals))


def stand_back() -> None:
    """Ask to run after everything that has a tick to keep; where it is called, a thread."""
    with suppress(OSError):
        Linux().be_nice(max(LAST, os.getpriority(os.PRIO_PROCESS, 0)))


def _named(wishes: Wishes) -> str:
    return ", ".join(sorted(wishes.required))
