"""Restarts programs that have ended: at once, then at growing intervals, up to a limit."""

from collections.abc import Callable
from time import monotonic

from pincette.engine.fleet import Child, Fleet

REVIVED = ("router", "upstream", "supervisor", "recorder")
"""Programs that are restarted. They do not belong to the loop, which continues without them, and a
held part stays held. A program of the loop is not restarted before a person has inspected the rig.
"""
FIRST_S, LONGEST_S = 0.5, 10.0
WELL_S = 60.0
"""Time in s for which a restarted program must run before its restart intervals begin again with
the shortest."""


class Revival:
    """Restarts the ended programs of a fleet; ``look`` is called several times a second.

    Each program has been ready once, so it is restarted whatever its exit status: a file that it
    cannot use now may be usable at the next attempt. If a program is never ready, the start of the
    fleet fails, and there is no revival.
    """

    def __init__(self, fleet: Fleet, clock: Callable[[], float] = monotonic) -> None:
        self._fleet, self._clock = fleet, clock
        self._wait_s: dict[str, float] = dict.fromkeys(REVIVED, FIRST_S)
        self._begun_s: dict[str, float] = dict.fromkeys(REVIVED, clock())
        self._due_s: dict[str, float] = {}
        self._told: set[int] = set()
        """Process ids whose end has been reported."""

    def look(self, say: Callable[[Child, str], None]) -> None:
        """Report each end, and each restarted program that serves again."""
        for member in self._fleet.ended():
            if member.process.pid not in self._told:
                self._told.add(member.process.pid)
                say(member, self._ended(member))
            elif self._clock() >= self._due_s.get(member.name, float("inf")):
                self._revive(member, say)

    def _revive(self, member: Child, say: Callable[[Child, str], None]) -> None:
        name, now_s = member.name, self._clock()
        try:
            self._fleet.revive(name)
        except OSError as error:  # no space for its log, no memory, or no process available
            self._due_s[name] = now_s + LONGEST_S
            say(
                member,
                f"cannot be restarted: {error}; the next attempt is in {LONGEST_S:g} s, the "
                "loop continues and a held part stays held",
            )
            return
        del self._due_s[name]
        self._begun_s[name] = now_s

    def _ended(self, member: Child) -> str:
        status, name = member.process.returncode, member.name
        words = f"ended, status {status}; see {member.log}"
        if name not in REVIVED:
            return words
        if self._clock() - self._begun_s[name] > WELL_S:
            self._wait_s[name] = FIRST_S
        wait_s = self._wait_s[name]
        self._wait_s[name] = min(2.0 * wait_s, LONGEST_S)
        self._due_s[name] = self._clock() + wait_s
        return f"{words}; restart in {wait_s:g} s, the loop continues and a held part stays held"
