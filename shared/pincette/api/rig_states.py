"""Tables of the states of a rig, and of the jobs that may start in each.

``RIG_STATES`` lists the states of the actuator, ``PART`` the certainty of its report about a part,
``OCCUPANTS`` the possible users of the rig, and ``MOTION`` the motions of the arm. The supervisor,
the page, the command line and the documentation read the same tables.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

RigState = Literal["unknown", "switched_on", "idle", "armed", "frozen", "ramping", "latched"]
Certainty = Literal["known", "believed", "unknown"]
"""Certainty of a report: recent; older but not contradicted; or unknown."""
PartState = Literal["none", "held", "unknown"]
ReportedPart = Literal["none", "held"]
Occupant = Literal["job", "ended_job", "part", "program", "unknown_part", "nothing"]
MotionState = Literal[
    "unheard",
    "tripped",
    "about_to_move",
    "unreported",
    "moving",
    "force_unknown",
    "force_unsteady",
    "at_rest",
]


class RigStateEntry(NamedTuple):
    """Meaning of a state of the actuator for people at the rig."""

    meaning: str
    may_start: bool
    """True if the actuator allows a job to start. A held part, a running job or a failing program
    may still prevent it."""
    may_move: bool
    """True if the actuator allows the stage to move. In the armed state, the motion program
    decides, and reports when it rests.
    """
    remedy: str = ""
    """Action that a person can take in this state; empty if none is needed."""


RIG_STATES: Mapping[RigState, RigStateEntry] = {
    "unknown": RigStateEntry(
        "no message from the actuator yet, or none for too long",
        may_start=False,
        may_move=False,
        remedy="check that its program runs; if in doubt, switch the amplifier off",
    ),
    "switched_on": RigStateEntry(
        "at its safe voltage since it was switched on; the first job clears that latch",
        may_start=True,
        may_move=True,
    ),
    "idle": RigStateEntry("at rest, ready for a job", may_start=True, may_move=True),
    "armed": RigStateEntry(
        "a motion program uses it, or it holds a part", may_start=True, may_move=True
    ),
    "frozen": RigStateEntry(
        "tripped while holding a part: it keeps the voltage for the rig file's time, then ramps",
        may_start=False,
        may_move=False,
        remedy="reset it to keep the part, then hold or release the part with a job",
    ),
    "ramping": RigStateEntry(
        "tripped: on its way to the safe voltage",
        may_start=False,
        may_move=False,
        remedy="wait until it is latched",
    ),
    "latched": RigStateEntry(
        "tripped: at its safe voltage until a person has acknowledged the cause",
        may_start=False,
        may_move=False,
        remedy="make sure that the rig is safe, then reset it",
    ),
}

_UNTOLD: Mapping[ReportedPart, Mapping[Certainty, Certainty]] = {
    reported: dict.fromkeys(("known", "believed", "unknown"), "unknown")
    for reported in ("none", "held")
}
"""Certainty in states in which nothing is known about the part, whatever the actuator reported
last.
"""
_EMPTY: Mapping[Certainty, Certainty] = {
    "known": "known",
    "believed": "believed",
    "unknown": "believed",
}
"""Certainty of an empty gripper. It stays certain, since no failure can make the gripper hold a
part.
"""
_UNCONFIRMED: Mapping[Certainty, Certainty] = {
    "known": "believed",
    "believed": "believed",
    "unknown": "unknown",
}
"""Certainty of a held part in states in which no voltage is written, so that none can be
confirmed.
"""

PART: Mapping[RigState, Mapping[ReportedPart, Mapping[Certainty, Certainty]]] = {
    "unknown": _UNTOLD,
    "switched_on": _UNTOLD,
    "idle": {"none": _EMPTY, "held": _UNCONFIRMED},
    "armed": {
        "none": _EMPTY,
        "held": {"known": "known", "believed": "believed", "unknown": "unknown"},
    },
    "frozen": {"none": _EMPTY, "held": _UNCONFIRMED},
    "ramping": _UNTOLD,
    "latched": _UNTOLD,
}
"""Certainty of the part, by three keys: the last state of the actuator, its report about the part,
and the certainty due to the age of that report.
"""


class OccupantEntry(NamedTuple):
    """The current user of the rig, and the jobs that can start at present."""

    meaning: str
    may_start: bool
    """True if a job that needs an empty gripper can start."""
    may_take_over: bool
    """True if a job that begins with a part already held can start."""


OCCUPANTS: Mapping[Occupant, OccupantEntry] = {
    "job": OccupantEntry("a job uses the rig", may_start=False, may_take_over=False),
    "ended_job": OccupantEntry(
        "a job that has ended holds a part", may_start=False, may_take_over=True
    ),
    "part": OccupantEntry(
        "a part is held: only hold and release can start", may_start=False, may_take_over=True
    ),
    "program": OccupantEntry(
        "the actuator is armed, but not for a job of this supervisor; wait until that "
        "motion has ended",
        may_start=False,
        may_take_over=False,
    ),
    "unknown_part": OccupantEntry(
        "it is not known whether a part is held", may_start=True, may_take_over=True
    ),
    "nothing": OccupantEntry("the gripper is empty", may_start=True, may_take_over=False),
}


class MotionEntry(NamedTuple):
    """Motion of the arm, and whether the stage may move at the same time."""

    meaning: str
    may_move: bool


MOTION: Mapping[MotionState, MotionEntry] = {
    "unheard": MotionEntry(
        "no message from the actuator yet, or none for too long", may_move=False
    ),
    "tripped": MotionEntry("the actuator has tripped", may_move=False),
    "about_to_move": MotionEntry("a job is about to move the arm", may_move=False),
    "unreported": MotionEntry("the controller does not report its program", may_move=False),
    "moving": MotionEntry("the arm moves", may_move=False),
    "force_unknown": MotionEntry("the force on the part is not known", may_move=False),
    "force_unsteady": MotionEntry("the force is off its reference", may_move=False),
    "at_rest": MotionEntry("the arm rests, and a held part is held steadily", may_move=True),
}
