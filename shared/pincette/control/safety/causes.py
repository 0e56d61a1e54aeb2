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
"""Modes in the safe state or during the transition to it."""
AT_REST = frozenset({Mode.IDLE, Mode.LATCHED})
"""Modes in which no command is accepted and the voltage is constant."""


class Cause(StrEnum):
    """Reason why a rig is latched; the accompanying faults contain the numbers."""

    NONE = ""
    """Not tripped."""
    BOOT = "boot"
    """The actuator has just started, and the previous one did not die: it ended cleanly, or there
    was none."""
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
    """The machine was suspended; it is not known what happened to arm and part in the meantime."""
    SHUTDOWN = "shutdown"
    """The program was asked to end."""
    RESTART = "restart"
    """The actuator was started after the previous one had died."""
    ESTOP = "estop"
    ABORT = "abort"
    LEASE = "lease"
    SUPERVISOR = "supervisor"
    ASKED = "asked"
    """Another program requested the trip without a reason."""


class Predecessor(StrEnum):
    """The way the previous actuator program ended."""

    NONE = "none"
    """No previous program is known."""
    CLEAN = "clean"
    """It ended on request, with the arm free and without a latch unknown to an operator."""
    DIED = "died"
    """It was killed, failed, or left a latch unknown to an operator; or the note about its end is
    damaged."""


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
"""Causes that only the actuator itself can detect."""
BOOTED = frozenset({Cause.BOOT, Cause.RESTART})
"""Causes that are set at the start, without a detected fault."""
LETS_GO = frozenset({Cause.FORCE})
"""Causes after which a held part is released at once, because a freeze would continue to press
it."""


def as_asked(cause: Cause) -> Cause:
    """Return the cause to report for a trip that another program requests.

    A cause that only the actuator itself can detect is replaced by ``ASKED``. Otherwise a request
    could use the cause of a start, which is easier to reset than a trip.
    """
    return Cause.ASKED if not cause or cause in OWN else cause
