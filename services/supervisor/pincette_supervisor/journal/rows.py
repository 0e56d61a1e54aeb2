"""What the journal keeps, as the rest of the supervisor takes it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, cast

from pincette.api.states import ActionType, JobState


@dataclass(frozen=True, slots=True)
class ActionRow:
    """An action, and when and at which sample it took effect."""

    type: ActionType
    requested_at: str
    by: str
    seq: int | None = None
    applied_at: str | None = None


@dataclass(frozen=True, slots=True)
class JobRow:
    """A job as it is kept."""

    id: str
    kind: str
    rig: str
    state: JobState
    request: dict[str, Any]
    plan: dict[str, Any]
    created_at: str
    cause: str = ""
    result: dict[str, Any] | None = None
    started_at: str | None = None
    ended_at: str | None = None
    actions: tuple[ActionRow, ...] = field(default=())
    number: int = 0
    """Rises with every job, and is its place in the queue; 0 until it is kept."""
    revision: int = 0
    """Rises with every change of the job and of its actions."""
    epoch: int | None = None
    """Of its arming, once there is one."""
    requested_by: str | None = None
    """Who asked for it; None of a job that was taken before that was kept."""


@dataclass(frozen=True, slots=True)
class Creation:
    """What an ``Idempotency-Key`` has created."""

    job: str
    fingerprint: str
    """Of the request that came with the key."""


@dataclass(frozen=True, slots=True)
class EventRow:
    """Something that happened, for whoever listens."""

    number: int | None
    """Rises with every event that is kept; None of what is told in passing."""
    at: str
    rig: str
    job: str | None
    kind: str
    body: dict[str, Any]


def utc_now() -> str:
    """The present time in UTC, for people; nothing in the loop reads it."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def job_row(columns: Mapping[str, Any], actions: tuple[ActionRow, ...]) -> JobRow:
    """A job of the columns of its table."""
    values: dict[str, Any] = {**columns, "actions": actions}
    if values["epoch"] is not None:
        values["epoch"] = int(values["epoch"])
    return JobRow(**values)


def action_row(columns: Mapping[str, Any]) -> ActionRow:
    """An action of the columns of its table."""
    return ActionRow(
        type=cast(ActionType, columns["type"]),
        requested_at=columns["requested_at"],
        by=columns["requested_by"],
        seq=columns["seq"],
        applied_at=columns["applied_at"],
    )
