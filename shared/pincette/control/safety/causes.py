"""Modes of the actuator, causes of a trip, and how the previous program ended."""

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
    """Why a rig is latched; the accompanying faults have the numbers."""

    NONE = ""
    """Not tripped."""
    BOOT = "boot"
    """The actuator has just started, and no previous one has died."""
    COMMAND_AGE = "command_age"
    """No command arrived in time."""
    FORCE = "force"
    """The estimated force exceeds the hard limit."""
    FOLLOWING_ERROR = "following_error"
    """The arm is too far from the position that the law requests."""
    POSITION = "position"
    """The measured position exceeds the hard limits."""
    DEVICE = "device"
    """The voltage output failed or refused a command."""
    SUSPEND = "suspend"
    """The machine was suspended: what happened to arm and part meanwhile is unknown."""
    SHUTDOWN = "shutdown"
    """The program was requested to end."""
    RESTART = "restart"
    """The actuator was restarted after the previous one had died."""
    ESTOP = "estop"
    ABORT = "abort"
    LEASE = "lease"
    SUPERVISOR = "supervisor"
    ASKED = "asked"
    """Another program requested the trip without a reason."""


class Predecessor(StrEnum):
    """How the previous actuator program has ended."""

    NONE = "none"
    """No previous program is known."""
    CLEAN = "clean"
    """It ended on request, with the arm free and no latch that an operator had not seen."""
    DIED = "died"
    """It was killed, failed, or left an unseen latch; or the note is damaged."""


CAUSES = tuple(cause for cause in Cause if cause != Cause.NONE)
"""All causes that the actuator reports."""
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
"""Causes of an actuator that has itself detected no fault."""
LETS_GO = frozenset({Cause.FORCE})
"""Causes for which a held part is released at once: a freeze would continue to press."""


def as_asked(cause: Cause) -> Cause:
    """Return the cause of a trip that another program requests.

    A cause that only the actuator itself can detect is reported as ``ASKED``: a rig that has only
    booted is cleared more easily than one that was tripped.
    """
    return Cause.ASKED if not cause or cause in OWN else cause
