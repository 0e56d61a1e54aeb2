"""The life of a job as data: states, events, deadlines, and what a person may ask for in each.

The program, the documents and the tests read the same table.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

JobState = Literal[
    "queued",
    "preparing",
    "ready",
    "running",
    "stopping",
    "aborting",
    "succeeded",
    "stopped",
    "aborted",
    "failed",
    "interrupted",
]
Event = Literal[
    "prepare",
    "prepared",
    "start",
    "done",
    "fail",
    "stop",
    "abort",
    "trip",
    "overdue",
    "confirm",
    "interrupt",
]
ActionType = Literal["start", "stop", "abort", "release", "continue"]
Need = Literal["held", "waiting"]
Beyond = Literal["", "program", "freeze"]


class TransitionError(Exception):
    """An event that the state does not know."""


@dataclass(frozen=True, slots=True)
class State:
    """One state: what it means, where each event leads, and when it has taken too long."""

    meaning: str
    events: Mapping[Event, JobState] = field(default_factory=dict[Event, JobState])
    deadline_s: float | None = None
    """Every state that ends in -ing has one; when it passes, the event is ``overdue``."""
    beyond: Beyond = ""
    """What the deadline is added to: the planned duration, or the actuator's freeze and ramp."""
    actions: tuple[ActionType, ...] = ()
    """Those that have a need are offered only while it is met; see ``NEEDS``."""

    @property
    def terminal(self) -> bool:
        """Whether nothing follows."""
        return not self.events


STATES: Mapping[JobState, State] = {
    "queued": State(
        "accepted",
        {"prepare": "preparing", "stop": "stopped", "abort": "aborted", "interrupt": "interrupted"},
        actions=("stop", "abort"),
    ),
    "preparing": State(
        "the programs of the rig are asked whether they can",
        {
            "prepared": "ready",
            "fail": "failed",
            "stop": "stopping",
            "abort": "aborting",
            "overdue": "aborting",
            "interrupt": "interrupted",
        },
        deadline_s=15.0,
        actions=("stop", "abort"),
    ),
    "ready": State(
        "waits for the action start",
        {
            "start": "running",
            "fail": "failed",
            "stop": "stopped",
            "abort": "aborted",
            "interrupt": "interrupted",
        },
        actions=("start", "stop", "abort"),
    ),
    "running": State(
        "the controller plays the program",
        {
            "done": "succeeded",
            "fail": "failed",
            "stop": "stopping",
            "abort": "aborting",
            "trip": "aborting",
            "overdue": "aborting",
            "interrupt": "interrupted",
        },
        deadline_s=30.0,
        beyond="program",
        actions=("stop", "abort", "release", "continue"),
    ),
    "stopping": State(
        "the controller was asked to stop; a held part stays held",
        {
            "confirm": "stopped",
            "fail": "failed",
            "abort": "aborting",
            "trip": "aborting",
            "overdue": "aborting",
            "interrupt": "interrupted",
        },
        deadline_s=30.0,
        actions=("abort",),
    ),
    "aborting": State(
        "the actuator is on its way to its safe state",
        {
            "confirm": "aborted",
            "fail": "failed",
            "overdue": "failed",
            "interrupt": "interrupted",
        },
        deadline_s=3.0,
        beyond="freeze",
    ),
    "succeeded": State("the program ended as planned"),
    "stopped": State("stopped, as the rig has confirmed", actions=("release", "abort")),
    "aborted": State("the actuator is safe and latched, because a person asked for it"),
    "failed": State("ended by a fault, which the cause names"),
    "interrupted": State("the supervisor ended while the job ran"),
}

NEEDS: Mapping[ActionType, Need] = {"release": "held", "continue": "waiting"}
"""What must be the case for an action to be offered: a part is held, the program waits for a
person."""

HOLDS: Mapping[ActionType, tuple[JobState, ...]] = {
    "start": ("running",),
    "stop": ("stopping", "stopped"),
    "abort": ("aborting", "aborted"),
    "release": (),
    "continue": (),
}
"""States in which what an action asks for holds already."""

OUTCOMES: Mapping[str, str] = {
    "gripped": "the part was gripped, held and let go as planned",
    "tracked": "the part was gripped, the path tracked and the part let go as planned",
    "released": "the part was gripped, held, and let go by the action release",
    "moved": "the motion was played to its end",
    "stopped": "the program was stopped",
    "no_contact": "no part was met where the plan expects one",
    "wrong_stiffness": "what was met is harder or softer than the part of the plan",
    "lost": "the part was lost while it was held",
    "overforce": "the force rose above its limit",
    "overtravel": "the arm came to a position limit of the rig file; ask for less voltage",
    "zero_refused": "the force could not be zeroed before contact",
}
"""How a program ends, in the controller's codes."""
GOOD_OUTCOMES = ("gripped", "tracked", "released", "moved")


def next_state(state: JobState, event: Event) -> JobState:
    """Where an event leads; raises TransitionError where the state does not know it."""
    try:
        return STATES[state].events[event]
    except KeyError:
        raise TransitionError(f"a job that is {state} knows no {event}") from None


def allowed_actions(state: JobState, *, held: bool, waiting: bool = False) -> list[ActionType]:
    """What may be asked for; an ended job matters only while it holds a part."""
    if STATES[state].terminal and not held:
        return []
    met: dict[Need | None, bool] = {None: True, "held": held, "waiting": waiting}
    return [action for action in STATES[state].actions if met[NEEDS.get(action)]]
