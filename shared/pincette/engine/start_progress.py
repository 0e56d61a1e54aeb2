"""Distinguishes a program that starts slowly from one that has stalled."""

import os
from collections.abc import Callable
from pathlib import Path
from time import monotonic

STALLED_S = 60.0
"""Time without progress after which a start counts as failed, in s."""
LONGEST_S = 900.0
"""Time after which a start counts as failed in any case, in s."""
LEAST_S = 0.6
"""Smallest processor time in s, used or waited for within ``STALLED_S``, that counts as progress.

A program that polls uses less.
"""
NEWS_S = 10.0
"""Time between two lines about a program that is still starting, in s."""


def demand_s(pid: int) -> float:
    """Return the processor time that a process and its children have used or waited for, in s.

    A program that starts on a busy machine mostly waits for a processor; one that hangs does not.
    """
    total_s = _demand_of(pid)
    for task in _listed(Path(f"/proc/{pid}/task")):
        try:
            children = Path(f"/proc/{pid}/task/{task}/children").read_text(encoding="ascii").split()
        except OSError:
            continue
        total_s += sum(demand_s(int(child)) for child in children)
    return total_s


def _demand_of(pid: int) -> float:
    total_ns = 0
    for task in _listed(Path(f"/proc/{pid}/task")):
        try:
            fields = Path(f"/proc/{pid}/task/{task}/schedstat").read_text(encoding="ascii").split()
        except OSError:
            continue
        total_ns += sum(map(int, fields[:2]))
    return 1e-9 * total_ns


def _listed(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)  # noqa: PTH208  a list of names is what is wanted
    except OSError:
        return []


class StartProgress:
    """Progress of one program's start: its processor time, and what it logs."""

    def __init__(
        self,
        demand: Callable[[], float],
        logged: Callable[[], int],
        clock: Callable[[], float] = monotonic,
    ) -> None:
        """``logged``: length of the program's log in bytes."""
        self._demand, self._logged, self._clock = demand, logged, clock
        self._begun_s = self._moved_s = self._told_s = clock()
        self._moved_at = 0.0, logged()

    def why_given_up(self) -> str:
        """Return the reason to give up the start; empty while there is progress."""
        now_s, demand, logged = self._clock(), self._demand(), self._logged()
        before, length = self._moved_at
        if demand - before >= LEAST_S or logged != length:
            self._moved_at, self._moved_s = (demand, logged), now_s
        if now_s - self._moved_s > STALLED_S:
            return (
                f"has made no progress for {STALLED_S:g} s: it has logged nothing and has used "
                f"less than {LEAST_S:g} s of processor time"
            )
        if now_s - self._begun_s > LONGEST_S:
            return f"is not ready after {LONGEST_S:g} s"
        return ""

    def news(self) -> str:
        """Return a line about a start that takes long, at most once per ``NEWS_S``; otherwise an
        empty text.
        """
        now_s = self._clock()
        if now_s - self._told_s < NEWS_S:
            return ""
        self._told_s = now_s
        return (
            f"is starting for {now_s - self._begun_s:.0f} s; processor used or awaited: "
            f"{self._demand():.1f} s"
        )
