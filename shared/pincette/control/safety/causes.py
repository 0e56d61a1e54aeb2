"""Modes of the actuator, why it trips, and how the one before it has ended."""

from enum import StrEnum


class Mode(StrEnum):
    """Mode of the actuator."""

    LATCHED = "latched"
    IDLE = "idle"
    ARMED = "armed"
    FROZEN = "frozen"
    RAMPING = "ramping"


TRIPPED = frozenset({Mode.FROZEN, Mode.RAMPING, Mode.LATCHED})
"""Modes in the safe state, or on the way there."""
AT_REST = frozenset({Mode.IDLE, Mode.LATCHED})
"""Modes in which no command is accepted and the voltage does not move."""


class Cause(StrEnum):
    """Why a rig is latched; the faults beside it have the numbers."""

    NONE = ""
    """Not tripped."""
    BOOT = "boot"
    """The actuator has just started, and none before it has died."""
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
    SUSPEND = "suspend"
    """The machine was suspended: nobody knows what has become of arm and part meanwhile."""
    SHUTDOWN = "shutdown"
    """The program was told to end."""
    RESTART = "restart"
    """The actuator was restarted after one that has died."""
    ESTOP = "estop"
    ABORT = "abort"
    LEASE = "lease"
    SUPERVISOR = "supervisor"
    ASKED = "asked"
    """Another program asked for it, and did not say why."""


class Predecessor(StrEnum):
    """How the previous actuator program has ended."""

    NONE = "none"
    """None is known."""
    CLEAN = "clean"
    """It was told to end, with the arm free and nothing latched that a person had not seen."""
    DIED = "died"
    """It was killed, failed, or left an unseen latch; or the note is damaged."""


CAUSES = tuple(cause for cause in Cause if cause != Cause.NONE)
"""All that the actuator tells."""
OWN = frozenset(
    {
        Cause.BOOT,
        Cause.COMMAND_AGE,
        Cause.FORCE,
        Cause.FOLLOWING_ERROR,
        Cause.POSITION,
        Cause.DEVICE,
        Cause.SUSPEND,
        Cause.SHUTDOWN,
        Cause.RESTART,
    }
)
"""Causes that only the actuator itself finds."""
BOOTED = frozenset({Cause.BOOT, Cause.RESTART})
"""Causes of an actuator that has tripped by nothing that it has seen itself."""
LETS_GO = frozenset({Cause.FORCE})
"""Causes for which a held part is let go at once: to freeze would be to press on."""


def as_asked(cause: Cause) -> Cause:
    """Return the cause of a trip that another program requests.

    A cause that only the actuator itself can find is reported as requested: a rig that has only
    booted is cleared more easily than one that was tripped.
    """
    return Cause.ASKED if not cause or cause in OWN else cause
