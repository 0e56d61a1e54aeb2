"""Series over REST: one request for many jobs; and the table of the states of a series."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import Field, model_validator

from pincette.api import WHOLE, Model, example
from pincette.api.requests import Label
from pincette.api.states import JobState

SeriesState = Literal["running", "paused", "stopped", "completed"]
SeriesActionType = Literal["pause", "resume", "stop"]

SERIES_LABEL, NUMBER_LABEL = "series", "series_job"
"""Labels of each job of a series: the id of the series, and the number of the job in it."""
MOST_JOBS = 1000
"""Largest number of jobs of one series."""


@dataclass(frozen=True, slots=True)
class SeriesStateMeaning:
    """A state of a series: its meaning, and the state to which each action leads."""

    meaning: str
    actions: Mapping[SeriesActionType, SeriesState]
    over: bool = False
    """True if the series has ended, so that callers that wait for its end get a reply."""


SERIES_STATES: Mapping[SeriesState, SeriesStateMeaning] = {
    "running": SeriesStateMeaning(
        "starts its jobs one after the other", {"pause": "paused", "stop": "stopped"}
    ),
    "paused": SeriesStateMeaning(
        "starts no further job until `resume`; a job that runs goes on",
        {"resume": "running", "stop": "stopped"},
        over=True,
    ),
    "stopped": SeriesStateMeaning(
        "stopped by a person or by its stop rule; `resume` goes on with the next job",
        {"resume": "running"},
        over=True,
    ),
    "completed": SeriesStateMeaning("all jobs have ended", {}, over=True),
}
"""States of a series. The supervisor, the documents and the tests read this table."""
TARGETS: Mapping[SeriesActionType, SeriesState] = {
    "pause": "paused",
    "resume": "running",
    "stop": "stopped",
}
"""State that fulfils the purpose of an action."""


class SeriesRequest(Model):
    """A request for many jobs on one rig, one after another.

    Only one of ``values``, ``grid`` and ``csv`` may be given; without any, all jobs are equal.
    """

    model_config = example(
        name="beads of lot 7",
        job={"kind": "grip", "recipe": "bead-1mm", "hold_s": 1.0},
        values=[{"sample": "B1", "force_mN": 8.0}, {"sample": "B2", "force_mN": 12.0}],
        repeats=2,
        shuffle_seed=7,
        stop_after_failures=3,
    )

    name: Label = ""
    """Name of the series, for people."""
    rig: str | None = Field(default=None, max_length=40)
    """Name of the rig; may be omitted if there is only one."""
    job: dict[str, Any] = Field(default_factory=dict[str, Any])
    """Members that all jobs have in common, as in a request for one job. ``rig``, ``autostart``,
    ``queue`` and ``dry_run`` are determined by the series.
    """
    values: list[dict[str, Any]] = Field(default_factory=list[dict[str, Any]], max_length=MOST_JOBS)
    """Additional members of each job; one entry per job."""
    grid: dict[str, Annotated[list[Any], Field(min_length=1, max_length=MOST_JOBS)]] = Field(
        default_factory=dict[str, list[Any]]
    )
    """Lists of values by member. There is one job per combination; the last member changes
    fastest.
    """
    csv: str = ""
    """Table in CSV: a header line with the names of the members, such as ``sample,force_mN``, then
    one line per job. The column ``label.NAME`` contains a label; an empty cell omits the member.
    """
    repeats: Annotated[int, Field(ge=1, le=MOST_JOBS), WHOLE] = 1
    """Number of times that the list of all jobs is run."""
    shuffle_seed: Annotated[int, Field(ge=0, le=2**31 - 1), WHOLE] | None = None
    """Seed of the random order of all jobs; null for the given order."""
    stop_after_failures: Annotated[int, Field(ge=1, le=MOST_JOBS), WHOLE] | None = 1
    """Number of failed jobs after which the series stops; null: it continues regardless of
    failures.
    """
    pause_s: float = Field(default=0.0, ge=0, le=86_400)
    """Time between the end of a job and the start of the next one."""
    after_restart: Literal["wait", "continue"] = "wait"
    """Behaviour after a restart of the supervisor. ``wait``: the series is paused until a person
    resumes it. ``continue``: it continues automatically. In both cases an interrupted job is
    repeated.
    """
    dry_run: bool = False
    """True to plan and predict all jobs only, without starting any."""

    @model_validator(mode="after")
    def _one_source(self) -> "SeriesRequest":
        given = [name for name in ("values", "grid", "csv") if getattr(self, name)]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} exclude each other: leave one out")
        return self


class SeriesAction(Model):
    """Request for an action on a series."""

    model_config = example(type="pause")

    type: SeriesActionType
    """``pause`` starts no further job; the running one continues to its end. ``stop`` also stops
    the running job; a held part stays held. ``resume`` continues with the next job, and resets the
    count of failures to 0.
    """


class SeriesJob(Model):
    """A job of a series, whether or not it has started."""

    model_config = example(
        number=1,
        request={"kind": "grip", "sample": "B1", "force_mN": 8.0},
        planned_s=9.4,
        job="20260301-120000-1f0c",
        state="succeeded",
        cause="",
        tries=1,
    )

    number: int
    """Number of the job in the series, from 1."""
    request: dict[str, Any]
    planned_s: float | None
    """Planned duration; null if the job has no end, or if it was unknown when the series was
    created.
    """
    job: str | None
    """Identifier of the job; null before it is created. After a repetition it is that of the newest
    job.
    """
    state: JobState | None
    cause: str
    tries: int = 0
    """Number of jobs created for this entry: more than 1 after a `retry` or an interruption."""


class SeriesSummary(Model):
    """A series without the list of its jobs."""

    model_config = example(
        id="20260301-115900-7c2e",
        name="beads of lot 7",
        rig="demo",
        state="running",
        cause="",
        total=4,
        ended=1,
        failed=0,
        job="20260301-120020-1f0d",
        remaining_s=28.2,
        allowed_actions=["pause", "stop"],
        by="cell-7",
        created_at="2026-03-01T11:59:00.000Z",
        ended_at=None,
    )

    id: str
    name: str
    rig: str
    state: SeriesState
    cause: str
    """Reason why the series does not start its next job; empty if it does."""
    total: int
    """Number of jobs."""
    ended: int
    """Number of jobs that have ended."""
    failed: int
    """Number of ended jobs that did not succeed."""
    job: str | None
    """Identifier of the newest job."""
    remaining_s: float | None
    """Estimated time until the end, from the planned durations and the pace so far; null if it is
    unknown.
    """
    allowed_actions: list[SeriesActionType]
    by: str | None
    """Client that requested the series, in the form of a job's ``by``."""
    created_at: str
    ended_at: str | None
    """Time at which the series was stopped or completed; null before."""


class Series(SeriesSummary):
    """A series: its request, its progress, and its jobs in order."""

    model_config = example(
        id="20260301-115900-7c2e",
        name="beads of lot 7",
        rig="demo",
        state="running",
        cause="",
        total=1,
        ended=0,
        failed=0,
        job=None,
        remaining_s=9.4,
        allowed_actions=["pause", "stop"],
        by="cell-7",
        created_at="2026-03-01T11:59:00.000Z",
        ended_at=None,
        request={"job": {"kind": "grip", "force_mN": 8.0}},
        jobs=[
            {
                "number": 1,
                "request": {"kind": "grip", "force_mN": 8.0},
                "planned_s": 9.4,
                "job": None,
                "state": None,
                "cause": "",
                "tries": 0,
            }
        ],
        traceparent=None,
    )

    request: dict[str, Any]
    jobs: list[SeriesJob]
    traceparent: str | None = None
    """W3C trace context of the request, which all jobs inherit; null without one."""


class SeriesPlan(Model):
    """Result of a dry run: all jobs of the series in order; nothing was started."""

    model_config = example(total=1, planned_s=9.4, jobs=[])

    total: int
    planned_s: float | None
    """Planned duration of all jobs and the pauses between them; null if it is unknown."""
    jobs: list[SeriesJob]


class SeriesList(Model):
    """Series, newest first."""

    model_config = example(series=[], next=None)

    series: list[SeriesSummary]
    next: str | None = None
    """Value of ``before`` for the next page; null at the end."""


def allowed_series_actions(state: SeriesState) -> list[SeriesActionType]:
    """Return the actions that a series accepts in a state."""
    actions = SERIES_STATES[state].actions
    return [one for one in get_args(SeriesActionType) if one in actions]
