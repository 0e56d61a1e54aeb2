"""Who goes first on one machine: the loop, then the system, then what plans, draws and records.

Wishes, not needs: where one is not permitted the program runs as others do, and says so. To be
asked before the bus is joined, since only threads that begin afterwards inherit the answer.
"""

import logging
import os
import sys
from pathlib import Path

log = logging.getLogger(__name__)
FIFO = 10
"""Above every fair task, below the threads of the kernel."""
FIRST = -10
LAST = 10
AUTOGROUP = Path("/proc/self/autogroup")
"""Where Linux weighs sessions against each other, see sched(7)."""


def come_first() -> None:
    """Ask to run before plots, tests and browsers.

    A fair scheduler lets a thread that wakes up wait for the slices of others, a few ms each; a
    tick has a dozen such waits one after another. So a fixed priority is asked for first.
    """
    if sys.platform != "linux":
        return
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO))
    except OSError:
        if not _niceness(FIRST):
            log.info(
                "runs at normal priority, so a busy machine delays its ticks: neither a priority "
                "(ulimit -r %d) nor a niceness (ulimit -e %d) is permitted",
                FIFO,
                20 - FIRST,
            )


def stand_back() -> None:
    """Ask to run after everything that has a tick to keep; where it is called, a thread."""
    _niceness(max(LAST, os.getpriority(os.PRIO_PROCESS, 0)))


def _niceness(wanted: int) -> bool:
    """Take a niceness; where tasks are grouped by session it counts for the group alone."""
    try:
        os.setpriority(os.PRIO_PROCESS, 0, wanted)
        if os.getsid(0) == os.getpid() and AUTOGROUP.exists():
            AUTOGROUP.write_text(str(wanted), encoding="ascii")
    except OSError:
        return False
    return True
