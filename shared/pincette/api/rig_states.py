"""The states of a rig as one table: what each means, whether a job may start, the stage may move.

REST, the page, the command line and the documentation read it; there is no other state.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

RigState = Literal["unknown", "switched_on", "idle", "armed", "frozen", "ramping", "latched"]


class RigStateEntry(NamedTuple):
    """What a state of the actuator means for those who work at the rig."""

    meaning: str
    may_start: bool
    """Whether a job can start as far as the actuator goes; a held part, a job or a program that
    fails may still stand in its way."""
    may_move: bool
    """Whether the stage may move as far as the actuator goes; while it is armed the program
    decides, which says when it rests."""
    remedy: str = ""
    """What a person does about it; empty where there is nothing to do."""


RIG_STATES: Mapping[RigState, RigStateEntry] = {
    "unknown": RigStateEntry(
        "the actuator has not been heard, or not for too long",
        may_start=False,
        may_move=False,
        remedy="see that its program runs; switch the amplifier off where in doubt",
    ),
    "switched_on": RigStateEntry(
        "at its safe voltage since it was switched on; the first job clears that latch by itself",
        may_start=True,
        may_move=True,
    ),
    "idle": RigStateEntry("at rest, ready for a job", may_start=True, may_move=True),
    "armed": RigStateEntry(
        "a program has it, or a part is held by it", may_start=True, may_move=True
    ),
    "frozen": RigStateEntry(
        "tripped with a part: it keeps the voltage for the rig file's time, then ramps",
        may_start=False,
        may_move=False,
        remedy="reset it to keep the part, then hold or release it by a job",
    ),
    "ramping": RigStateEntry(
        "tripped: on its way to the safe voltage",
        may_start=False,
        may_move=False,
        remedy="wait until it is latched",
    ),
    "latched": RigStateEntry(
        "tripped: at its safe voltage until a person has seen the cause",
        may_start=False,
        may_move=False,
        remedy="see that the rig is safe, then reset it",
    ),
}
