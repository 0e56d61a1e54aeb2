"""The loop before everything else on the same machine."""

import logging
import os

log = logging.getLogger(__name__)
NICENESS = -10


def come_first() -> None:
    """Ask the scheduler to run this program before plots, tests and browsers.

    To be asked before the bus is joined, since only threads that begin afterwards inherit it. A
    wish, not a need: where it is not permitted the program runs as others do.
    """
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    except PermissionError:
        log.info("runs at normal priority: a niceness of %d is not permitted", NICENESS)
