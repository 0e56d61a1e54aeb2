"""Codes of what programs tell each other; texts for people are made in ``core.wording``."""

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
    """How a program ends, by the controller."""

    NONE = ""
    """Nothing is reached yet."""
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
    """Phases that the controller itself knows; a program may have others, as levels of voltage."""

    APPROACH = "approach"
    LOAD = "load"
    HOLD = "hold"
    SETTLE = "settle"
    TRACK = "track"
    UNLOAD = "unload"
    RETREAT = "retreat"
    STOPPING = "stopping"
    STOPPED = "stopped"
    """A part is kept with the force that it had when the program was stopped on its way."""


KEPT = (Phase.HOLD, Phase.STOPPED)
"""Phases in which a part is kept at rest."""


class ActionCode(StrEnum):
    """What the controller can be asked for; see ``messages.Action``."""

    STOP = "stop"
    LET_GO = "let_go"
    RETRACT = "retract"
    PAUSE = "pause"
    RESUME = "resume"
    RELEASE = "release"
    CONTINUE = "continue"
    KEEP = "keep"


class LeaseEnd(StrEnum):
    """How a program is stopped whose lease has ended; each is an action too."""

    STOP = "stop"
    LET_GO = "let_go"
    RETRACT = "retract"


class Acted(StrEnum):
    """What took effect at a sample; every stop is ``stop``, one of the lease after ``lease``."""

    LEASE = "lease"
    STOP = "stop"
    PAUSE = "pause"
    RESUME = "resume"
    RELEASE = "release"
    CONTINUE = "continue"
