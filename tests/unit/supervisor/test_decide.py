"""The rules for a running job, checked with every combination of facts in every state."""

from collections.abc import Iterator
from typing import cast

import pytest

from pincette.api.endings import Ending
from pincette.api.states import GOOD_OUTCOMES, STATES, JobState
from pincette.core.faults import ActionCode, Cause, Outcome
from pincette_supervisor.alarms import TripReason
from pincette_supervisor.jobs.decide import (
    AWAITING,
    ENDS,
    PLAYED,
    STOPPABLE,
    TERMINAL,
    TRIPPABLE,
    Ask,
    Asked,
    AskTrip,
    Close,
    Command,
    Complete,
    Facts,
    Interrupt,
    Move,
    TakeDefault,
    Why,
    decide,
)

BOTH = (False, True)
LATE: Why = ("late", Ending(code="silent"))
LEASE: Why = ("lease", Ending(code="lease_ended"))
LACK: Why = ("lack", Ending(code="samples_missing"))
UNSAFE: Why = ("unsafe", Ending(code="tripped"))
TRIPS = (None, TripReason(Cause.ABORT), TripReason(Cause.COMMAND_AGE))
ASKED: tuple[Asked, ...] = ("no", "refused", "accepted", "effective")
VALUES: dict[str, tuple[object, ...]] = {
    "over": BOTH,
    "trip": TRIPS,
    "outcome": (Outcome.NONE, Outcome.GRIPPED, Outcome.STOPPED, Outcome.LOST),
    "held": BOTH,
    "paused": BOTH,
    "interrupted": BOTH,
    "late": (None, LATE),
    "cut_off": BOTH,
    "lease": (None, LEASE),
    "cut_short": (None, LACK),
    "lack": (None, LACK),
    "asked": ASKED,
    "stop_acts": BOTH,
    "pause_asked": BOTH,
    "trip_asked": BOTH,
    "given_up": BOTH,
    "on_stop": (ActionCode.STOP, ActionCode.RETRACT),
    "unsafe": (None, UNSAFE),
    "waited": BOTH,
}
"""Values of each fact."""


def wrong(facts: Facts, command: Command | None) -> str:
    """Return the fault of a command; empty if there is none."""
    events = STATES[facts.state].events
    if facts.state in AWAITING:
        return "" if decide_wait(facts) == command else "the wait ends otherwise"
    if isinstance(command, TakeDefault):
        return "a default decision outside the wait for one"
    if facts.state in TERMINAL:
        expected = Complete if facts.over or facts.late else Interrupt
        if facts.over or facts.late or facts.interrupted:
            return "" if isinstance(command, expected) else "the record is not completed"
        return "" if command is None else "a command for a job that has ended"
    if facts.trip and facts.state in TRIPPABLE:
        return "" if command == Move("trip") else "a trip does not take precedence"
    match command:
        case Move(event=event) | Close(event=event) if event not in events:
            return "the state does not know the event"
        case Move(event="trip" | "overdue") | AskTrip() if (
            facts.cut_off and facts.state in TRIPPABLE
        ):
            return "a trip although the end of the lease stops the loop"
        case Ask() if facts.asked != "no" or facts.over or facts.interrupted or facts.late:
            return "an action in a state that does not allow it"
        case Ask(action=action):
            of_state = {
                "stopping": facts.on_stop,
                "pausing": ActionCode.PAUSE,
                "resuming": ActionCode.RESUME,
            }
            return "" if of_state.get(facts.state) == action else "an action of another state"
        case AskTrip() if facts.state != "aborting" or facts.trip_asked:
            return "a trip request in a state that does not need it"
        case Close(event="done") if not facts.over or facts.outcome not in GOOD_OUTCOMES:
            return "a failed job is reported as a success"
        case Close(over=False) if not (facts.held and facts.stop_acts):
            return "a job is closed before its last sample"
        case Complete():
            return "the record is completed before the end of the job"
        case _ if facts.over and not isinstance(command, Close | Move):
            return "a job continues after its last sample"
        case None if facts.interrupted or facts.late:
            return "nothing is done"
        case _:
            return ""


def decide_wait(facts: Facts) -> Command | None:
    """Return the only command that is valid for a job that waits for a decision."""
    if facts.interrupted:
        return Move("interrupt", ENDS)
    if facts.unsafe:
        return Move("fail", facts.unsafe)
    return TakeDefault() if facts.waited else None


class UnknownFactError(Exception):
    """A fact is read whose value has not been chosen."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.name = name


class PartialFacts:
    """Facts of which only some have a value."""

    def __init__(self, chosen: dict[str, object]) -> None:
        self.__dict__.update(chosen)

    def __getattr__(self, name: str) -> object:
        raise UnknownFactError(name)


def faults(state: JobState) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield the fault of each wrong command in a state, and the facts that were read.

    A fact gets each of its values once it is read; those that are not read have no influence.
    """
    open_cases: list[dict[str, object]] = [{"state": state}]
    while open_cases:
        chosen = open_cases.pop()
        facts = cast(Facts, PartialFacts(chosen))
        try:
            words = wrong(facts, decide(facts))
        except UnknownFactError as unknown:
            name = "late" if unknown.name == "cut_off" and "late" not in chosen else unknown.name
            # A loop that is cut off is late.
            values = VALUES[name] if name != "cut_off" or chosen["late"] else (False,)
            open_cases += [{**chosen, name: value} for value in values]
        else:
            if words:
                yield words, chosen


@pytest.mark.parametrize("state", sorted(PLAYED | TERMINAL | AWAITING))
def test_every_combination_of_facts_gives_a_valid_command(state: JobState) -> None:
    assert list(faults(state)) == []


def test_the_states_in_which_a_job_can_trip_or_be_stopped_are_derived_correctly() -> None:
    assert {"running", "pausing", "paused", "resuming", "stopping"} == TRIPPABLE
    assert {"running", "pausing", "paused", "resuming"} == STOPPABLE


@pytest.mark.parametrize(
    ("facts", "command"),
    [
        (Facts(state="running"), None),
        (Facts(state="running", lease=LEASE), Move("stop", LEASE)),
        (Facts(state="running", lack=LACK), Move("stop", LACK)),
        (Facts(state="running", late=LATE), Move("overdue", LATE)),
        (Facts(state="paused", late=LATE, paused=True), Move("trip", LATE)),
        (Facts(state="running", over=True, outcome=Outcome.GRIPPED), Close("done")),
        (Facts(state="running", over=True, outcome=Outcome.LOST), Close("fail")),
        (Facts(state="running", over=True, outcome=Outcome.STOPPED), Move("stop")),
        (Facts(state="running", over=True, outcome=Outcome.RELEASED), Close("done")),
        (Facts(state="running", over=True, outcome=Outcome.RELEASED, cut_short=LACK),
         Move("stop", LACK)),
        (Facts(state="stopping", over=True), Close("confirm")),
        (Facts(state="stopping", over=True, given_up=True), Close("fail")),
        (Facts(state="stopping", asked="effective", held=True, stop_acts=True),
         Close("confirm", over=False)),
        (Facts(state="running", late=LATE, lack=LACK), Move("overdue", LATE)),
        (Facts(state="running", trip=TRIPS[2], lease=LEASE, over=True), Move("trip")),
        (Facts(state="running", late=LATE, cut_off=True), Close("fail", LATE)),
        (Facts(state="paused", late=LATE, cut_off=True, paused=True), Close("fail", LATE)),
        (Facts(state="aborting", late=LATE, cut_off=True), AskTrip()),
        (Facts(state="stopping"), Ask(ActionCode.STOP)),
        (Facts(state="stopping", on_stop=ActionCode.RETRACT), Ask(ActionCode.RETRACT)),
        (Facts(state="stopping", asked="effective", stop_acts=True), None),
        (Facts(state="stopped", held=True), None),
        (Facts(state="stopped", over=True), Complete()),
        (Facts(state="stopped", interrupted=True), Interrupt()),
        (Facts(state="aborting"), AskTrip()),
        (Facts(state="aborting", late=LATE), AskTrip()),
        (Facts(state="aborting", interrupted=True), Interrupt()),
        (Facts(state="aborting", trip_asked=True), None),
        (Facts(state="aborting", over=True, trip=TRIPS[1]), Close("confirm")),
        (Facts(state="aborting", over=True, trip=TRIPS[2]), Close("fail")),
        (Facts(state="aborting", trip_asked=True, late=LATE), Close("fail", LATE)),
        (Facts(state="pausing"), Ask(ActionCode.PAUSE)),
        (Facts(state="pausing", asked="effective", paused=True), Move("rest")),
        (Facts(state="pausing", asked="refused"), None),
        (Facts(state="resuming"), Move("go_on")),
        (Facts(state="resuming", pause_asked=True), Ask(ActionCode.RESUME)),
        (Facts(state="resuming", pause_asked=True, asked="accepted"), None),
        (Facts(state="resuming", pause_asked=True, asked="refused"), Move("go_on")),
        (Facts(state="awaiting_recovery", over=True, outcome=Outcome.LOST), None),
        (Facts(state="awaiting_recovery", over=True, waited=True), TakeDefault()),
        (Facts(state="awaiting_recovery", unsafe=UNSAFE, waited=True), Move("fail", UNSAFE)),
        (Facts(state="awaiting_recovery", unsafe=UNSAFE, interrupted=True),
         Move("interrupt", ENDS)),
        (Facts(state="paused"), Move("go_on")),
        (Facts(state="paused", paused=True), None),
    ],
)  # fmt: skip
def test_each_set_of_facts_gives_the_expected_command(
    facts: Facts, command: Command | None
) -> None:
    assert decide(facts) == command
