"""Rules that decide what a running job does next.

``STATES`` defines the transitions between states. ``RULES`` defines which event, or which command
to the rig, follows from the facts that ``JobMonitor`` has collected. The first rule that applies
gives the command. After the command is carried out, the facts are collected again.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from pincette.api.endings import Ending
from pincette.api.states import GOOD_OUTCOMES, STATES, Event, JobState
from pincette.core.faults import ActionCode, Cause, Outcome
from pincette_supervisor.alarms import TripReason

States = frozenset[JobState]
TERMINAL: States = frozenset(name for name, state in STATES.items() if state.terminal)
TRIPPABLE: States = frozenset(name for name, state in STATES.items() if "trip" in state.events)
STOPPABLE: States = frozenset(name for name in TRIPPABLE if "stop" in STATES[name].events)
RUNNING: States = frozenset({"running"})
PAUSING: States = frozenset({"pausing"})
PAUSED: States = frozenset({"paused"})
RESUMING: States = frozenset({"resuming"})
STOPPING: States = frozenset({"stopping"})
ABORTING: States = frozenset({"aborting"})
AWAITING: States = frozenset({"awaiting_recovery"})
PLAYED: States = TRIPPABLE | ABORTING
"""States of a job whose program is loaded and that has not ended."""
Asked = Literal["no", "refused", "accepted", "effective"]
"""Progress of the command to the controller that belongs to the present state."""
Why = tuple[str, Ending]
"""Message and code of a cause."""
ENDS: Why = ("the supervisor ended", Ending(code="supervisor_ended"))


@dataclass(slots=True, kw_only=True)
class Facts:
    """Facts about a job and its rig at one moment."""

    state: JobState
    over: bool = False
    """True if no further sample of this arming is expected."""
    trip: TripReason | None = None
    """Reason why the actuator tripped; None if it has not."""
    outcome: Outcome = Outcome.NONE
    """Outcome of the program."""
    held: bool = False
    """True while a part is held."""
    paused: bool = False
    """True while the references are at rest."""
    interrupted: bool = False
    """True if the supervisor shuts down."""
    late: Why | None = None
    """Cause if the loop is silent or the time limit of the state has passed."""
    cut_off: bool = False
    """True if no message arrives and no program replies; in this case the lease ends the
    program.
    """
    lease: Why | None = None
    """Cause if the controller has stopped because its lease expired."""
    cut_short: Why | None = None
    """Cause if the part was released before the requested force or path had begun."""
    lack: Why | None = None
    """Cause if more samples are missing than the kind of job allows."""
    asked: Asked = "no"
    stop_acts: bool = False
    """True once a stop has taken effect."""
    pause_asked: bool = False
    """True from the request of a pause until the program continues."""
    trip_asked: bool = False
    """True once a trip of the actuator was requested."""
    given_up: bool = False
    """True once the job was stopped because samples are missing."""
    on_stop: ActionCode = ActionCode.STOP
    """Command to the controller for a stop."""
    unsafe: Why | None = None
    """Cause if the actuator is latched while the job waits for a decision."""
    waited: bool = False
    """True if the time for a decision has passed."""


@dataclass(frozen=True, slots=True)
class Move:
    """Change the job's state by an event."""

    event: Event
    why: Why | None = None


@dataclass(frozen=True, slots=True)
class Ask:
    """Request an action of the controller; sent once in each state."""

    action: ActionCode


@dataclass(frozen=True, slots=True)
class AskTrip:
    """Request a trip of the actuator."""


@dataclass(frozen=True, slots=True)
class Close:
    """Evaluate the result and end the job; recording continues unless ``over``."""

    event: Event
    why: Why | None = None
    over: bool = True


@dataclass(frozen=True, slots=True)
class Complete:
    """Complete the record of a job that ended while a part was held."""


@dataclass(frozen=True, slots=True)
class Interrupt:
    """Leave the rig stopped because the supervisor ends."""


@dataclass(frozen=True, slots=True)
class TakeDefault:
    """Take the default decision on a grip that did not succeed."""


Command = Move | Ask | AskTrip | Close | Complete | Interrupt | TakeDefault


@dataclass(frozen=True, slots=True)
class Rule:
    """Command for some states, given when a condition holds."""

    states: States
    when: Callable[[Facts], object]
    then: Callable[[Facts], Command]


def _late(facts: Facts) -> Command:
    return Move("overdue" if "overdue" in STATES[facts.state].events else "trip", facts.late)


def _tripped(facts: Facts) -> Command:
    requested = facts.trip is not None and facts.trip.cause == Cause.ABORT
    return Close("confirm" if requested else "fail")


def _goes_on(facts: Facts) -> bool:
    if not facts.pause_asked or facts.asked == "refused":
        return True
    return facts.asked == "effective" and not facts.paused


RULES: tuple[Rule, ...] = (
    Rule(TERMINAL, lambda f: f.over or f.late, lambda _: Complete()),
    Rule(TRIPPABLE, lambda f: f.trip, lambda _: Move("trip")),
    Rule(STOPPABLE, lambda f: f.lease, lambda f: Move("stop", f.lease)),
    Rule(PLAYED, lambda f: f.over and f.trip, _tripped),
    Rule(
        STOPPING | ABORTING,
        lambda f: f.over,
        lambda f: Close("fail" if f.given_up else "confirm"),
    ),
    Rule(STOPPABLE, lambda f: f.over and f.outcome == Outcome.STOPPED, lambda _: Move("stop")),
    Rule(STOPPABLE, lambda f: f.over and f.cut_short, lambda f: Move("stop", f.cut_short)),
    Rule(
        PLAYED,
        lambda f: f.over,
        lambda f: Close("done" if f.outcome in GOOD_OUTCOMES else "fail"),
    ),
    Rule(PLAYED | TERMINAL, lambda f: f.interrupted, lambda _: Interrupt()),
    Rule(ABORTING, lambda f: not f.trip_asked and f.trip is None, lambda _: AskTrip()),
    Rule(ABORTING, lambda f: f.late, lambda f: Close("fail", f.late)),
    # Fail without a trip: the loop probably works, and a trip would drop the part.
    Rule(TRIPPABLE, lambda f: f.late and f.cut_off, lambda f: Close("fail", f.late)),
    Rule(TRIPPABLE, lambda f: f.late, _late),
    Rule(RUNNING, lambda f: f.lack, lambda f: Move("stop", f.lack)),
    Rule(STOPPING, lambda f: f.asked == "no", lambda f: Ask(f.on_stop)),
    Rule(
        STOPPING,
        lambda f: f.stop_acts and f.held and f.on_stop == ActionCode.STOP,
        lambda _: Close("confirm", over=False),
    ),
    Rule(PAUSING, lambda f: f.asked == "no", lambda _: Ask(ActionCode.PAUSE)),
    Rule(PAUSING, lambda f: f.asked == "effective" and f.paused, lambda _: Move("rest")),
    Rule(
        RESUMING,
        lambda f: f.pause_asked and f.asked == "no",
        lambda _: Ask(ActionCode.RESUME),
    ),
    Rule(RESUMING, _goes_on, lambda _: Move("go_on")),
    # Nothing moves while a job waits, so no trip is requested; a latched actuator ends the wait.
    Rule(AWAITING, lambda f: f.interrupted, lambda _: Move("interrupt", ENDS)),
    Rule(AWAITING, lambda f: f.unsafe, lambda f: Move("fail", f.unsafe)),
    Rule(AWAITING, lambda f: f.waited, lambda _: TakeDefault()),
    # A guard or a release can end a pause.
    Rule(PAUSED, lambda f: not f.paused, lambda _: Move("go_on")),
)


def decide(facts: Facts) -> Command | None:
    """Return the command of the first rule that applies, or None."""
    for rule in RULES:
        if facts.state in rule.states and rule.when(facts):
            return rule.then(facts)
    return None
