"""A UTC clock that never goes back, used to check expiry dates of keys and certificates.

A person, a time server, or a computer without a battery can set the time of day back. An expired
key or certificate would then be valid again.
"""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from time import CLOCK_BOOTTIME, clock_gettime

LAST = datetime(9000, 1, 1, tzinfo=UTC)
"""Latest time that is accepted, so that no sum of times overflows."""


def since_boot_s() -> float:
    """Return the time since the boot in s, including the time of a suspended computer."""
    return clock_gettime(CLOCK_BOOTTIME)


def utc() -> datetime:
    """Return the time of day in UTC."""
    return datetime.now(UTC)


class LatestTime:
    """The later of the time of day and of the time counted since the latest time seen.

    Safe to use from several threads.
    """

    def __init__(
        self, wall: Callable[[], datetime] = utc, clock_s: Callable[[], float] = since_boot_s
    ) -> None:
        """``clock_s``: a clock that never steps."""
        self._wall, self._clock_s = wall, clock_s
        self._latest = wall(), clock_s()
        """Latest time seen, and the reading of ``clock_s`` at that moment; one tuple, which is
        replaced as a whole."""

    def now(self) -> datetime:
        """Return the time, which is never before an earlier one."""
        wall, clock_s = self._wall(), self._clock_s()
        counted = self._counted(clock_s)
        if wall < counted:
            return counted
        self._latest = wall, clock_s
        return wall

    def learn(self, seen: datetime) -> None:
        """Include a time that an earlier program has seen."""
        clock_s = self._clock_s()
        if seen > self._counted(clock_s):
            self._latest = min(seen, LAST), clock_s

    @property
    def ahead(self) -> timedelta:
        """Return by how many seconds this clock is ahead of the time of day."""
        return max(timedelta(0), self._counted(self._clock_s()) - self._wall())

    def agree(self) -> None:
        """Continue from the time of day, which a person has confirmed."""
        self._latest = self._wall(), self._clock_s()

    def _counted(self, clock_s: float) -> datetime:
        latest, at_s = self._latest
        return latest + timedelta(seconds=clock_s - at_s)
