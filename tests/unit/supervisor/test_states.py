"""The table of job states: every transition."""

from typing import get_args

import pytest

from pincette.api.endings import ENDINGS, EndingCode
from pincette.api.results import OutcomeCode
from pincette.api.states import (
    BEYOND,
    EVENTS,
    HOLDS,
    OUTCOMES,
    STATES,
    ActionType,
    Event,
    JobState,
    TransitionError,
    allowed_actions,
    next_state,
)
from pincette.core.faults import Outcome

EVENT_NAMES: tuple[Event, ...] = get_args(Event)
MOVING: tuple[JobState, ...] = ("preparing", "running", "pausing", "paused", "resuming")


def reachable(start: JobState) -> set[JobState]:
    seen: set[JobState] = set()
    ahead: list[JobState] = [start]
    while ahead:
        state = ahead.pop()
        if state not in seen:
            seen.add(state)
            ahead += STATES[state].events.values()
    return seen


def test_every_job_state_is_declared_and_reachable() -> None:
    assert set(STATES) == set(get_args(JobState)) == reachable("proposed")


@pytest.mark.parametrize("state", [s for s in STATES if s.endswith("ing")])
def test_a_transitional_state_has_a_deadline_that_leads_to_aborting_or_failed(
    state: JobState,
) -> None:
    assert STATES[state].deadline_s is not None
    assert next_state(state, "overdue") == ("failed" if state == "aborting" else "aborting")


def test_only_transitional_states_have_deadlines() -> None:
    late = {state for state, row in STATES.items() if row.deadline_s is not None}
    assert late == {state for state in STATES if state.endswith("ing")}


def test_every_state_can_reach_a_final_state_and_final_states_are_never_left() -> None:
    ends = {state for state in STATES if STATES[state].terminal}
    assert ends == {"succeeded", "stopped", "aborted", "failed", "interrupted"}
    for state in STATES:
        assert reachable(state) & ends
        if state not in ends and state not in ("proposed", "queued"):
            assert next_state(state, "interrupt") == "interrupted"


@pytest.mark.parametrize("state", ["proposed", "queued"])
def test_a_job_that_has_not_begun_survives_a_restart(state: JobState) -> None:
    assert "interrupt" not in STATES[state].events


@pytest.mark.parametrize("state", list(STATES))
def test_each_event_leads_to_the_state_of_the_table_or_is_refused(state: JobState) -> None:
    for event in EVENT_NAMES:
        if event in STATES[state].events:
            assert next_state(state, event) in STATES
        else:
            with pytest.raises(TransitionError, match=f"{state} has no event {event}"):
                next_state(state, event)


@pytest.mark.parametrize("state", list(STATES))
def test_an_allowed_action_is_an_event_of_the_state_or_acts_on_a_held_part(
    state: JobState,
) -> None:
    free = allowed_actions(state, held=False)
    if STATES[state].terminal:
        assert free == []
    assert all(action in STATES[state].events for action in free)
    assert set(free) <= set(allowed_actions(state, held=True))


def test_a_part_can_be_released_from_the_hold_and_after_a_stop() -> None:
    assert "release" in allowed_actions("running", held=True)
    assert "release" in allowed_actions("stopped", held=True)
    assert allowed_actions("stopped", held=False) == []


def test_stop_and_abort_lead_to_states_in_which_the_request_is_fulfilled() -> None:
    assert set(HOLDS) == set(get_args(ActionType))
    for state in MOVING:
        assert next_state(state, "stop") in HOLDS["stop"]
        assert next_state(state, "abort") in HOLDS["abort"]


def test_a_stop_of_a_paused_job_does_not_go_through_the_state_running() -> None:
    assert next_state("paused", "stop") == "stopping"
    assert "running" not in reachable("stopping")


def test_a_pause_returns_to_its_earlier_state() -> None:
    pause: tuple[tuple[Event, JobState], ...] = (
        ("pause", "pausing"),
        ("rest", "paused"),
        ("resume", "resuming"),
        ("go_on", "running"),
    )
    state: JobState = "running"
    for event, expected in pause:
        state = next_state(state, event)
        assert state == expected


@pytest.mark.parametrize("state", [state for state in STATES if not STATES[state].terminal])
def test_a_job_can_be_aborted_or_stopped_wherever_it_moves(state: JobState) -> None:
    offered = allowed_actions(state, held=True)
    if state == "aborting":
        assert offered == []
    else:
        assert "abort" in offered
        assert ("stop" in offered) == (state != "stopping")


def test_every_event_and_every_reason_for_a_longer_deadline_has_a_description() -> None:
    assert set(EVENTS) == set(EVENT_NAMES)
    assert all(EVENTS.values())
    assert {row.beyond for row in STATES.values()} == set(BEYOND)


def test_all_outcomes_and_endings_have_meanings() -> None:
    assert all(OUTCOMES.values())
    assert set(ENDINGS) == set(get_args(EndingCode))
    played = {str(outcome) for outcome in Outcome if outcome}
    assert set(get_args(OutcomeCode)) == played | {"tripped", "unfinished"}


@pytest.mark.parametrize("state", list(STATES))
def test_continue_is_offered_only_while_the_program_waits(state: JobState) -> None:
    assert "continue" not in allowed_actions(state, held=True)
    waiting = allowed_actions(state, held=False, waiting=True)
    assert ("continue" in waiting) == (state in ("running", "pausing"))
