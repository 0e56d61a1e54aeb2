"""Modes of the actuator, and why it trips."""

from enum import StrEnum


class Mode(StrEnum):
    """What the actuator does."""

    LATCHED = "latched"
    IDLE = "idle"
    ARMED = "armed"
    FROZEN = "frozen"
    RAMPING = "ramping"


TRIPPED = frozenset({Mode.FROZEN, Mode.RAMPING, Mode.LATCHED})
"""In the safe state, or on the way there."""


class Cause(StrEnum):
    """Why a rig is latched; the faults beside it have the numbers."""

    NONE = ""
    """It is not."""
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
    RESTART = "restart"
    """The actuator was started anew, as the supervisor sees."""
    ESTOP = "estop"
    ABORT = "abort"
    LEASE = "lease"
    SUPERVISOR = "supervisor"
    ASKED = "asked"
    """Another program asked for it, and did not say why."""


CAUSES = tuple(cause for cause in Cause if cause not in (Cause.NONE, Cause.RESTART))
"""All that the actuator tells."""
OWN = frozenset(
    {
        Cause.BOOT,
        Cause.COMMAND_AGE,
        Cause.FORCE,
        Cause.FOLLOWING_ERROR,
        Cause.POSITION,
        Cause.DEVICE,
        Cause.SHUTDOWN,
        Cause.RESTART,
    }
)
"""Causes that only the actuator itself finds."""
LETS_GO = frozenset({Cause.FORCE})
"""Causes for which a held part is let go at once: to freeze would be to press on."""


def as_asked(cause: Cause) -> Cause:
    """The cause of a trip that another program asks for.

    What claims to be the actuator's own finding is told as asked for: a rig that has only booted
    is cleared more easily than one that was tripped.
    """
    return Cause.ASKED if not cause or cause in OWN else cause
