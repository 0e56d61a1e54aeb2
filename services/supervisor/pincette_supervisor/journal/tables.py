"""The journal's tables, which ``migrations`` creates, and the rows that are read from them."""

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, NamedTuple

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    PrimaryKeyConstraint,
    String,
    Table,
    column,
    table,
)

from pincette.api.jobs import DESCRIPTION
from pincette.api.states import ActionType, JobState

METADATA = MetaData()


JOBS = Table(
    "jobs",
    METADATA,
    Column("id", String, primary_key=True),
    Column("number", Integer, nullable=False, unique=True),
    Column("kind", String, nullable=False),
    Column("rig", String, nullable=False),
    Column("state", String, nullable=False),
    Column("cause", String, nullable=False),
    Column("ending", JSON(none_as_null=True)),
    Column("request", JSON, nullable=False),
    Column("plan", JSON, nullable=False),
    Column("result", JSON(none_as_null=True)),
    Column("epoch", String),
    Column("revision", Integer, nullable=False),
    Column("created_at", String, nullable=False),
    Column("started_at", String),
    Column("ended_at", String),
    Column("requested_by", String),
    *(Column(name, String, nullable=False) for name in DESCRIPTION),
    Column("labels", JSON, nullable=False),
    Column("pinned", Boolean, nullable=False),
    Column("priority", Integer, nullable=False),
    Column("place", Integer),
    Column("traceparent", String),
    *(
        Index(f"ix_jobs_{name}_number", name, "number", "created_at")
        for name in ("rig", "state", "kind", "sample", "batch", "operator", "pinned")
    ),
    Index("ix_jobs_number_created_at", "number", "created_at"),
    Index("ix_jobs_listed", "number", "created_at", "rig", "kind", "state", "pinned"),
    Index("ix_jobs_counted", "rig", "kind", "state"),
)
"""Jobs. Each new job has a higher ``number``; each change increases the ``revision``; ``place`` is
the position in the queue.
"""

JOB_SEARCH = table("job_search", column("rowid", Integer), column("words", String))
"""Full-text index of a journal file (FTS5 of SQLite): text, labels and outcome of each job, by the
number of the job. Triggers of the file keep it up to date."""

ACTIONS = Table(
    "actions",
    METADATA,
    Column("job", String, ForeignKey("jobs.id"), nullable=False),
    Column("number", Integer, nullable=False),
    Column("type", String, nullable=False),
    Column("requested_at", String, nullable=False),
    Column("requested_by", String, nullable=False),
    Column("applied_at", String),
    Column("seq", Integer),
    PrimaryKeyConstraint("job", "number"),
)

NOTES = Table(
    "notes",
    METADATA,
    Column("name", String, primary_key=True),
    Column("value", String, nullable=False),
)

EVENTS = Table(
    "events",
    METADATA,
    Column("number", Integer, primary_key=True, autoincrement=True),
    Column("at", String, nullable=False),
    Column("rig", String, nullable=False),
    Column("job", String, index=True),
    Column("kind", String, nullable=False),
    Column("body", JSON, nullable=False),
    sqlite_autoincrement=True,
)
"""Events that a listener must not miss; the number is the SSE id."""

CREATIONS = Table(
    "creations",
    METADATA,
    Column("key", String, primary_key=True),
    Column("fingerprint", String, nullable=False),
    Column("job", String, ForeignKey("jobs.id"), nullable=False),
    Column("created_at", String, nullable=False),
)
"""Jobs by the ``Idempotency-Key`` with which they were created; the fingerprint is a digest of
the request."""

SERIES = Table(
    "series",
    METADATA,
    Column("number", Integer, primary_key=True, autoincrement=True),
    Column("id", String, nullable=False, unique=True),
    Column("rig", String, nullable=False),
    Column("name", String, nullable=False),
    Column("state", String, nullable=False),
    Column("cause", String, nullable=False),
    Column("request", JSON, nullable=False),
    Column("jobs", JSON, nullable=False),
    Column("failures", Integer, nullable=False),
    Column("key", String, unique=True),
    Column("fingerprint", String, nullable=False),
    Column("requested_by", String),
    Column("created_at", String, nullable=False),
    Column("ended_at", String),
    Column("traceparent", String),
    Index("ix_series_rig_state", "rig", "state"),
    sqlite_autoincrement=True,
)
"""Series of jobs; ``jobs`` are the requests in their order. The jobs themselves are found by the
keys in ``creations``."""

RECIPES = Table(
    "recipes",
    METADATA,
    Column("name", String, nullable=False),
    Column("version", Integer, nullable=False),
    Column("values", JSON, nullable=False),
    Column("note", String, nullable=False),
    Column("created_at", String, nullable=False),
    PrimaryKeyConstraint("name", "version"),
)

TRAJECTORIES = Table(
    "trajectories",
    METADATA,
    Column("digest", String, primary_key=True),
    Column("rig", String, nullable=False),
    Column("request", JSON, nullable=False),
    Column("created_at", String, nullable=False),
)

LEARNED = Table(
    "learned",
    METADATA,
    Column("rig", String, nullable=False),
    Column("program", String, nullable=False),
    Column("job", String, nullable=False),
    Column("learned_at", String, nullable=False),
    Column("motion", JSON, nullable=False),
    *(Column(name, JSON, nullable=False) for name in ("values_um", "errors_um", "best_um")),
    Column("quiet", Integer, nullable=False),
    PrimaryKeyConstraint("rig", "program"),
)
"""Learned corrections of programs, by the digest of the program."""

SESSIONS = Table(
    "sessions",
    METADATA,
    Column("digest", String, primary_key=True),
    Column("key", String, nullable=False),
    Column("used_at", String, nullable=False),
)
"""Signed-in pages; ``digest`` is the digest of the cookie, ``key`` that of the key or user."""

AUDIT = Table(
    "audit",
    METADATA,
    Column("number", Integer, primary_key=True, autoincrement=True),
    Column("at", String, nullable=False),
    Column("who", String, nullable=False),
    Column("address", String, nullable=False),
    Column("action", String, nullable=False),
    Column("detail", String, nullable=False),
    Column("status", Integer, nullable=False),
    Column("count", Integer, nullable=False),
    Column("link", String, nullable=False),
    sqlite_autoincrement=True,
)
"""Requests and their callers; triggers of the file prevent changing or deleting a row."""

ALARMS = Table(
    "alarms",
    METADATA,
    Column("number", Integer, primary_key=True, autoincrement=True),
    Column("rig", String, nullable=False),
    Column("job", String),
    Column("severity", String, nullable=False),
    Column("cause", String, nullable=False),
    Column("words", String, nullable=False),
    Column("clears", String, nullable=False),
    Column("count", Integer, nullable=False),
    Column("raised_at", String, nullable=False),
    Column("last_at", String, nullable=False),
    Column("acknowledged_at", String),
    Column("acknowledged_by", String),
    Column("cleared_at", String),
    Index("ix_alarms_rig_cause", "rig", "cause"),
    sqlite_autoincrement=True,
)
"""Alarms, one row for each; ``count`` is the number of its occurrences while it is open."""


@dataclass(frozen=True, slots=True)
class ActionRow:
    """An action, with the time and the sample at which it took effect."""

    type: ActionType
    requested_at: str
    requested_by: str
    seq: int | None = None
    applied_at: str | None = None


@dataclass(frozen=True, slots=True)
class JobRow:
    """A job as it is stored."""

    id: str
    kind: str
    rig: str
    state: JobState
    request: dict[str, Any]
    plan: dict[str, Any]
    created_at: str
    cause: str = ""
    ending: dict[str, Any] | None = None
    """Reason of the end, as ``api.endings.Ending``."""
    result: dict[str, Any] | None = None
    started_at: str | None = None
    ended_at: str | None = None
    actions: tuple[ActionRow, ...] = ()
    number: int = 0
    """Number of the job, higher for each new job; 0 until it is stored."""
    revision: int = 0
    """Number of the newest revision; each change of the job or of its actions increases it."""
    epoch: int | None = None
    """Epoch of the job's arming; None before it."""
    requested_by: str | None = None
    """Caller who requested the job; None for a job that is older than this column."""
    traceparent: str | None = None
    """W3C trace context of the request; None without one."""
    sample: str = ""
    batch: str = ""
    operator: str = ""
    notes: str = ""
    labels: dict[str, str] = field(default_factory=dict[str, str])
    pinned: bool = False
    priority: int = 0
    """Priority in the queue; higher numbers come first."""
    place: int | None = None
    """Position in the queue, from 1; None if the job is not queued."""


class TableRow(NamedTuple):
    """Values of one job for a table of many jobs."""

    fixed: tuple[str | None, ...]
    """Values of the columns that every job has."""
    labels: str
    """Labels as JSON, like the fields below."""
    values: str
    """Requested values, completed, as JSON."""
    result: str


@dataclass(frozen=True, slots=True)
class Creation:
    """Job that an ``Idempotency-Key`` has created."""

    key: str
    fingerprint: str
    """Digest of the request with the key."""
    job: str
    created_at: str


def utc_text(time: datetime) -> str:
    """Return a time in the journal's format: in UTC, to a millisecond."""
    return time.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def utc_now() -> str:
    """Return the present time in UTC, for people; nothing in the loop reads it."""
    return utc_text(datetime.now(UTC))
