"""Modes of the actuator, and why it trips: one enumeration, and words that an operator reads."""

from enum import StrEnum
from typing import Literal

Mode = Literal["latched", "idle", "armed", "frozen", "ramping"]


class Cause(StrEnum):
    """Why a rig is latched. In ``Applied.cause`` it stands before a colon and the words."""

    BOOT = "boot"
    """The actuator has just started."""
    COMMAND_AGE = "command_age"
    """No command in time."""
    FORCE = "force"
    """The estimated force is beyond the hard limit."""
    FOLLOWING_ERROR = "following_error"
    """The arm is not where the law wants it."""
    POSITION = "position"
    """The measured position is beyond the hard limits."""
    DEVICE = "device"
    """The voltage output failed or refused."""
    SHUTDOWN = "shutdown"
    """The program was told to end."""
    ESTOP = "estop"
    ABORT = "abort"
    LEASE = "lease"
    SUPERVISOR = "supervisor"
    ASKED = "asked"
    """Another program asked for it, in other words than those."""

    def because(self, words: str = "") -> str:
        """Cause, colon, words."""
        return f"{self.value}: {words}" if words else self.value


OWN = frozenset(
    {
        Cause.BOOT,
        Cause.COMMAND_AGE,
        Cause.FORCE,
        Cause.FOLLOWING_ERROR,
        Cause.POSITION,
        Cause.DEVICE,
        Cause.SHUTDOWN,
    }
)
"""Causes that only the actuator itself finds."""
LETS_GO = frozenset({Cause.FORCE})
"""Causes for which a held part is let go at once: to freeze would be to press on."""
_KNOWN = {cause.value: cause for cause in Cause}


def cause_of(text: str) -> Cause:
    """The cause that a text of ``because`` begins with; ASKED where it begins with none."""
    return _KNOWN.get(text.partition(":")[0], Cause.ASKED)


def as_asked(text: str) -> str:
    """The cause of a trip that another program asks for.

    What claims to be the actuator's own finding is told as asked for: a rig that has only booted
    is cleared more easily than one that was tripped.
    """
    if not text or cause_of(text) in OWN:
        return Cause.ASKED.because(text)
    return text
