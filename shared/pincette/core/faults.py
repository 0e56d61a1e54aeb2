"""Codes that programs exchange; ``core.wording`` makes texts for people from them."""

from enum import StrEnum

from pincette.control.faults import Fault, FaultCode, Value, fault
from pincette.control.safety.causes import AT_REST, CAUSES, TRIPPED, Cause, Mode, Predecessor

__all__ = [
    "AT_REST",
    "CAUSES",
    "KEPT",
    "TRIPPED",
    "Acted",
    "ActionCode",
    "Cause",
    "Fault",
    "FaultCode",
    "LeaseEnd",
    "Mode",
    "Outcome",
    "Phase",
    "Predecessor",
    "Value",
    "fault",
]


class Outcome(StrEnum):
    """How a motion program ended, according to the controller."""

    NONE = ""
    """No outcome yet."""
    GRIPPED = "gripped"
    TRACKED = "tracked"
    RELEASED = "released"
    MOVED = "moved"
    STOPPED = "stopped"
    NO_CONTACT = "no_contact"
    WRONG_STIFFNESS = "wrong_stiffness"
    UNCERTAIN_FORCE = "uncertain_force"
    LOST = "lost"
    OVERFORCE = "overforce"
    CONTACT = "contact"
    OVERTRAVEL = "overtravel"
    ZERO_REFUSED = "zero_refused"
    SLIPPED = "slipped"
    SENSOR_JUMP = "sensor_jump"
    POSITION_STEP = "position_step"


class Phase(StrEnum):
    """Phases that the controller itself knows.

    A program may have additional phases, such as voltage levels.
    """

    APPROACH = "approach"
    LOAD = "load"
    HOLD = "hold"
    SETTLE = "settle"
    TRACK = "track"
    UNLOAD = "unload"
    RETREAT = "retreat"
    STOPPING = "stopping"
    STOPPED = "stopped"
    """A part is held with the force that it had when the program was stopped before its end."""


KEPT = (Phase.HOLD, Phase.STOPPED)
"""Phases in which a part is held at rest."""


class ActionCode(StrEnum):
    """Actions that the controller accepts; see ``messages.Action``."""

    STOP = "stop"
    LET_GO = "let_go"
    RETRACT = "retract"
    PAUSE = "pause"
    RESUME = "resume"
    RELEASE = "release"
    CONTINUE = "continue"
    KEEP = "keep"


class LeaseEnd(StrEnum):
    """Ways to stop a program when its lease ends; each is also an action."""

    STOP = "stop"
    LET_GO = "let_go"
    RETRACT = "retract"


class Acted(StrEnum):
    """Action that took effect at a sample.

    Every kind of stop is reported as ``stop``; if a lease has expired, ``lease`` precedes it.
    """

    LEASE = "lease"
    STOP = "stop"
    PAUSE = "pause"
    RESUME = "resume"
    RELEASE = "release"
    CONTINUE = "continue"
