"""Calls about jobs: plan, start, list, follow, act, and the files of their records."""

from collections.abc import Mapping
from typing import Any

from pincette.api.job_models import ArtifactList, Job, JobList
from pincette.api.plan_models import Plan
from pincette.api.states import STATES, ActionType, JobState
from pincette.client.call import Call, model
from pincette.client.kinds import PLANS, AnyPlan

SAFE_TO_REPEAT: tuple[ActionType, ...] = ("start", "pause", "stop", "abort")
"""Actions that do no more when they are asked for twice: a job starts once, and the others bring a
rig to rest. A second ``resume``, ``continue`` or ``release`` could act on what came since."""
LONGEST_WAIT_S = 30.0


def plan(body: dict[str, Any]) -> Call[AnyPlan]:
    """What a job would do; nothing moves."""
    query: dict[str, str | float] = {"dry_run": "true"}
    kind: type[AnyPlan] = PLANS.get(body.get("kind", ""), Plan)
    return Call("POST", "/jobs", model(kind), query, body, repeatable=True)


def plot(body: dict[str, Any]) -> Call[bytes]:
    """A picture of the plan of a grip, a track or a move, as PNG."""
    return Call(
        "POST", "/trajectories/plot", lambda response: response.content, body=body, repeatable=True
    )


def create(body: dict[str, Any], key: str) -> Call[Job]:
    """Take a job once, however often the call is made with this key."""
    headers = {"Idempotency-Key": key}
    return Call("POST", "/jobs", model(Job), body=body, headers=headers, repeatable=True)


def jobs(query: Mapping[str, str | float]) -> Call[JobList]:
    """Jobs, the newest first."""
    return Call("GET", "/jobs", model(JobList), query, repeatable=True)


def job(name: str, wait_s: float = 0.0) -> Call[Job]:
    """One job; with a time to wait, as soon as it has ended."""
    query: dict[str, str | float] = {"wait": "terminal", "timeout_s": wait_s} if wait_s else {}
    return Call("GET", f"/jobs/{name}", model(Job), query, repeatable=True, kept_s=wait_s)


def act(name: str, action: ActionType) -> Call[Job]:
    """Ask a job for an action."""
    return Call(
        "POST",
        f"/jobs/{name}/actions",
        model(Job),
        body={"type": action},
        repeatable=action in SAFE_TO_REPEAT,
    )


def artifacts(name: str) -> Call[ArtifactList]:
    """Files of a job's record."""
    return Call("GET", f"/jobs/{name}/artifacts", model(ArtifactList), repeatable=True)


def artifact(name: str, file: str) -> Call[bytes]:
    """One file of a job's record; its bytes are streamed by who sends the call."""
    return Call(
        "GET", f"/jobs/{name}/artifacts/{file}", lambda response: response.content, repeatable=True
    )


def ended(state: JobState) -> bool:
    """Whether a job in this state has come to its end."""
    return STATES[state].terminal


def wait_s(left_s: float | None) -> float:
    """How long one call may wait, of the time that is left in all."""
    return LONGEST_WAIT_S if left_s is None else max(0.0, min(LONGEST_WAIT_S, left_s))
