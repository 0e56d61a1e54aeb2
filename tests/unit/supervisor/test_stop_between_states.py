"""A stop that arrives between two states of a job is accepted, not refused for the earlier
state."""

from types import SimpleNamespace
from typing import Any

import pytest

from pincette.api.states import ActionType, JobState
from pincette_supervisor.jobs.job import JobStatus
from pincette_supervisor.jobs.job_manager import JobActions
from pincette_supervisor.journal.write_queue import WriteQueue
from pincette_supervisor.problems import ProblemError


class GoesOn:
    """A live job whose state advances whenever an action has read it."""

    def __init__(self, *states: JobState) -> None:
        self._states = list(states)
        self.moved: list[tuple[ActionType, JobState]] = []

    @property
    def status(self) -> JobStatus:
        return JobStatus(id="a", state=self._states[0], revision=1, entered_at=0.0)

    def move(self, action: ActionType, only_from: JobState) -> bool:
        if len(self._states) > 1:
            del self._states[0]
        if only_from != self.status.state:
            return False
        self.moved.append((action, only_from))
        return True

    def record_action(self, action: ActionType, by: str) -> None:
        """Do nothing."""


def act(job: Any, action: ActionType) -> bool:
    context: Any = SimpleNamespace(write_queue=WriteQueue())
    return JobActions(context).on_live(job, action, "me")


def test_a_stop_is_repeated_if_the_state_changes_meanwhile() -> None:
    job = GoesOn("preparing", "ready", "running")
    assert act(job, "stop") is False
    assert job.moved == [("stop", "running")]


def test_another_action_is_refused_with_the_present_state() -> None:
    job = GoesOn("running", "stopping")
    with pytest.raises(ProblemError, match="has just become stopping"):
        act(job, "pause")
    assert job.moved == []
