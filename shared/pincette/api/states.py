"""The states of a job as data: states, events, deadlines and allowed actions.

The program, the documents and the tests read the same table.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from pincette.api.recovery import Decision, RecoveryWait

JobState = Literal[
    "proposed",
    "queued",
    "preparing",
    "ready",
    "running",
    "pausing",
    "paused",
    "resuming",
    "awaiting_recovery",
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
    "pause",
    "rest",
    "resume",
    "go_on",
    "done",
    "fail",
    "stop",
    "abort",
    "trip",
    "overdue",
    "confirm",
    "interrupt",
    "recover",
    "retry",
    "retry_at",
    "accept",
    "give_up",
    "approve",
    "reject",
]
ActionType = Literal[
    "start",
    "pause",
    "resume",
    "stop",
    "abort",
    "release",
    "continue",
    "retry",
    "retry_at",
    "accept",
    "give_up",
    "approve",
    "reject",
]
Need = Literal["held", "waiting"]
Beyond = Literal["", "program", "letting_go", "freeze"]


class TransitionError(Exception):
    """Error for an event that the present state does not allow."""


@dataclass(frozen=True, slots=True)
class State:
    """A state of a job: its meaning, the next state after each event, and its deadline."""

    meaning: str
    events: Mapping[Event, JobState] = field(default_factory=dict[Event, JobState])
    deadline_s: float | None = None
    """Time limit of the state; every state whose name ends in -ing has one. When it expires, the
    event ``overdue`` occurs.
    """
    beyond: Beyond = ""
    """Name of a duration that is added to the deadline; see ``BEYOND``."""
    actions: tuple[ActionType, ...] = ()
    """Actions that are offered. An action with a condition in ``NEEDS`` is offered only while the
    condition is fulfilled."""

    @property
    def terminal(self) -> bool:
        """Return True if no other state can follow."""
        return not self.events


_MOVING: Mapping[Event, JobState] = {
    "fail": "failed",
    "stop": "stopping",
    "abort": "aborting",
    "trip": "aborting",
    "overdue": "aborting",
    "interrupt": "interrupted",
}
"""Transitions of every job whose program is loaded."""

STATES: Mapping[JobState, State] = {
    "proposed": State(
        (
            "waits until a person approves or rejects it, at most until `approval_until`; it "
            "survives a restart of the supervisor"
        ),
        {
            "approve": "queued",
            "reject": "stopped",
            "fail": "failed",
            "stop": "stopped",
            "abort": "aborted",
        },
        actions=("approve", "reject", "stop", "abort"),
    ),
    "queued": State(
        "accepted; waits for its turn; it survives a restart of the supervisor",
        {"prepare": "preparing", "fail": "failed", "stop": "stopped", "abort": "aborted"},
        actions=("stop", "abort"),
    ),
    "preparing": State(
        "planned with the model in use; the programs of the rig are asked whether they can",
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
        "the controller runs the motion program",
        {"done": "succeeded", "recover": "awaiting_recovery", "pause": "pausing", **_MOVING},
        deadline_s=30.0,
        beyond="program",
        actions=("pause", "stop", "abort", "release", "continue"),
    ),
    "pausing": State(
        "the motion program continues to its next safe point, where the references are at rest",
        {
            "rest": "paused",
            "resume": "resuming",
            "done": "succeeded",
            "recover": "awaiting_recovery",
            **_MOVING,
        },
        deadline_s=30.0,
        beyond="program",
        actions=("resume", "stop", "abort", "release", "continue"),
    ),
    "paused": State(
        (
            "the references are at rest; the law continues to hold force and position, and "
            "the guards stay active"
        ),
        {
            "resume": "resuming",
            "go_on": "running",
            "done": "succeeded",
            "recover": "awaiting_recovery",
            "fail": "failed",
            "stop": "stopping",
            "abort": "aborting",
            "trip": "aborting",
            "interrupt": "interrupted",
        },
        actions=("resume", "stop", "abort", "release"),
    ),
    "resuming": State(
        "the controller was requested to resume where it paused",
        {
            "go_on": "running",
            "done": "succeeded",
            "recover": "awaiting_recovery",
            **_MOVING,
        },
        deadline_s=5.0,
        actions=("stop", "abort"),
    ),
    "awaiting_recovery": State(
        (
            "the grip did not succeed, the arm is free and at rest, and the job waits for a "
            "decision; its `recovery` states the time limit and the default"
        ),
        {
            "retry": "failed",
            "retry_at": "failed",
            "accept": "succeeded",
            "give_up": "failed",
            "fail": "failed",
            "stop": "stopped",
            "abort": "aborted",
            "interrupt": "interrupted",
        },
        actions=("retry", "retry_at", "accept", "give_up", "stop", "abort"),
    ),
    "stopping": State(
        (
            "the controller was requested to stop; a held part stays held unless on_stop "
            "states otherwise"
        ),
        {
            "confirm": "stopped",
            "fail": "failed",
            "abort": "aborting",
            "trip": "aborting",
            "overdue": "aborting",
            "interrupt": "interrupted",
        },
        deadline_s=30.0,
        beyond="letting_go",
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
    "succeeded": State("the motion program ended as planned"),
    "stopped": State("stopped, and the rig has confirmed it", actions=("release", "abort")),
    "aborted": State("the actuator is safe and latched, because a person requested it"),
    "failed": State("ended by a fault, which `cause` states"),
    "interrupted": State("the supervisor ended while the job ran"),
}

EVENTS: Mapping[Event, str] = {
    "prepare": "its turn has come",
    "prepared": "every program of the rig has accepted it",
    "start": "the action start, or autostart",
    "pause": "the action pause",
    "rest": "the controller reports that the references are at rest",
    "resume": "the action resume; before the pause is complete it cancels the pause",
    "go_on": "the controller reports that the references move",
    "done": "the last sample, with a good outcome",
    "fail": "a bad outcome, or a program of the rig that does not reply",
    "stop": "the action stop",
    "abort": "the action abort",
    "trip": "the actuator has tripped",
    "overdue": "the deadline has passed",
    "confirm": "the rig reports that it is done",
    "interrupt": "the supervisor stops, or has stopped",
    "recover": "the program ended in a case of `recovery`, which the request has",
    "retry": "the action retry, or the default; a new job repeats the request",
    "retry_at": "the action retry_at; a new job repeats the request at another place",
    "accept": "the action accept, or the default",
    "give_up": "the action give_up, or the default",
    "approve": "the action approve; the job is planned again",
    "reject": "the action reject, or the time for an approval has passed",
}

BEYOND: Mapping[Beyond, str] = {
    "": "",
    "program": "planned duration, without pauses",
    "letting_go": "unload and retreat as planned, if on_stop requests them",
    "freeze": "the actuator's freeze and ramp",
}
"""Description of the durations that are added to deadlines."""

NEEDS: Mapping[ActionType, Need] = {"release": "held", "continue": "waiting"}
"""Conditions under which actions are offered: a part is held, or the program waits for a person."""

HOLDS: Mapping[ActionType, tuple[JobState, ...]] = {
    "start": ("running",),
    "pause": ("pausing", "paused"),
    "resume": ("resuming", "running"),
    "stop": ("stopping", "stopped"),
    "abort": ("aborting", "aborted"),
    "release": (),
    "continue": (),
    "retry": (),
    "retry_at": (),
    "accept": (),
    "give_up": (),
    "approve": (),
    "reject": (),
}
"""States in which the purpose of an action is already fulfilled, by action."""

OUTCOMES: Mapping[str, str] = {
    "gripped": "the part was gripped, held and released as planned",
    "tracked": "the part was gripped, the path tracked and the part released as planned",
    "released": "the part was held, and released if requested",
    "moved": "the motion ran to its end",
    "stopped": "the program was stopped",
    "no_contact": "no part was touched where the plan expects one",
    "wrong_stiffness": "what was touched is harder or softer than the part of the plan",
    "uncertain_force": "the uncertainty of the force grew as large as the force itself, so that a "
    "part could be pressed beyond the plan: repeat free_response, use a larger force, or reduce "
    "the noise of the sensor",
    "lost": "the part was lost while it was held",
    "overforce": "the force rose above its limit",
    "contact": "the arm touched something on its way through free space",
    "overtravel": (
        "the arm reached a position limit of the rig file; request less voltage, or widen the "
        "limit if the space is free"
    ),
    "zero_refused": "the force could not be zeroed before contact",
    "slipped": "the part gave way while it was loaded or moved; it was unloaded",
    "sensor_jump": (
        "the position stepped back without a change of the voltage, which a slip cannot cause: "
        "the sensor jumped, or something pushed the part; the voltage was kept, then the part "
        "was released"
    ),
    "position_step": (
        "the position of a held part stepped forwards without a change of the voltage, by a slip "
        "or by the sensor; the voltage was kept until the part was released, and the result "
        "states the force for both cases"
    ),
}
"""Meanings of the controller's outcome codes: the ways in which a motion program can end."""
GOOD_OUTCOMES = ("gripped", "tracked", "released", "moved")


def next_state(state: JobState, event: Event) -> JobState:
    """Return the state to which an event leads.

    Raises TransitionError if the state does not allow it.
    """
    try:
        return STATES[state].events[event]
    except KeyError:
        raise TransitionError(f"a job that is {state} has no event {event}") from None


def allowed_actions(
    state: JobState, *, held: bool, waiting: bool = False, recovery: RecoveryWait | None = None
) -> list[ActionType]:
    """Return the allowed actions. An ended job allows some only while it holds a part."""
    if STATES[state].terminal and not held:
        return []
    met: dict[Need | None, bool] = {None: True, "held": held, "waiting": waiting}
    refused = {*get_args(Decision)} - {*(() if recovery is None else recovery.decisions)}
    return [
        action
        for action in STATES[state].actions
        if met[NEEDS.get(action)] and action not in refused
    ]
