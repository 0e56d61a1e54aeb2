"""Jobs over REST: actions, edits, progress and the job itself."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from pincette.api import Model, example
from pincette.api.endings import Ending
from pincette.api.places import PartPlace
from pincette.api.recovery import RecoveryWait
from pincette.api.requests import Label, Labels, Notes
from pincette.api.states import ActionType, JobState

DESCRIPTION = ("sample", "batch", "operator", "notes")
"""Members of a job that describe it, in addition to its labels."""
ArtifactState = Literal["none", "being_written", "ready", "deleted"]


class ActionRequest(Model):
    """Request for an action on a job."""

    model_config = example(type="stop")

    type: ActionType
    place: PartPlace | None = None
    """Place at which ``retry_at`` expects the part. ``retry_at`` needs it; every other action is
    rejected with it.
    """

    @model_validator(mode="after")
    def _place_of_retry_at(self) -> "ActionRequest":
        if (self.type == "retry_at") != (self.place is not None):
            raise ValueError("place belongs to the action retry_at, which needs it")
        return self


class StopRequest(Model):
    """Request to stop the job of another request, even if that request has not created its job
    yet.
    """

    model_config = example(idempotency_key="cell 4, part 17")

    idempotency_key: Annotated[str, Field(min_length=1, max_length=255, pattern=r"^[ -~]+$")]
    """Idempotency key of the request that creates the job."""


class Action(Model):
    """A requested action, stored with its job."""

    model_config = example(
        type="release",
        requested_at="2026-03-01T12:00:09.250Z",
        by="127.0.0.1",
        applied_at="2026-03-01T12:00:09.291Z",
        seq=462,
    )

    type: ActionType
    requested_at: str
    by: str
    """Client that requested the action, in the form of a job's ``by``."""
    applied_at: str | None = None
    """Time at which the supervisor was notified that the action took effect."""
    seq: int | None = None
    """Number of the sample at which the action took effect; null before."""


class JobEdit(Model):
    """Changes of a job's notes, labels and pin, possible also after its end.

    Omitted members do not change.
    """

    model_config = example(sample="B7", notes="bead with a chip", pinned=True)

    sample: Label | None = None
    batch: Label | None = None
    operator: Annotated[str, Field(max_length=80)] | None = None
    notes: Notes | None = None
    labels: Labels | None = None
    """Labels that replace all existing labels."""
    pinned: bool | None = None
    """True keeps the record regardless of the age and size limits in the rig file."""


class Progress(Model):
    """Progress of a running job, computed from the newest samples."""

    model_config = example(
        phase="hold",
        seq=445,
        elapsed_s=8.9,
        planned_s=16.4,
        paused=False,
        percent=54.3,
        remaining_s=7.5,
        x_r_um=39.88,
        x_um=39.9,
        force_r_mN=20.0,
        force_mN=19.98,
        force_uncertainty_mN=0.41,
        voltage_V=2.49,
        held=True,
        hold_in_s=0.0,
        force_held_mN=19.99,
        target=20.0,
        current=19.98,
        unit="mN",
        instruction="",
        weight_mN=None,
    )

    phase: str
    seq: int
    elapsed_s: float
    planned_s: float | None
    """Planned duration without pauses; null for a hold without an end."""
    paused: bool = False
    percent: float | None = None
    """Percentage of the planned duration that is completed; null for a hold without an end."""
    remaining_s: float | None = None
    """Remaining planned time, in s; it stays constant during a pause."""
    x_r_um: float | None = None
    """Reference of the position."""
    x_um: float | None
    force_r_mN: float | None = None
    """Reference of the contact force."""
    force_mN: float | None
    force_uncertainty_mN: float | None
    voltage_V: float | None
    """Applied voltage; null while the output has not confirmed it."""
    held: bool
    hold_in_s: float | None = None
    """Planned time until the hold begins; 0 during the hold, null if there is no hold."""
    force_held_mN: float | None = None
    """Mean force in the hold after its first half second, of both arms if there are two; null
    before, and once the zero of the force is invalid.
    """
    target: float | None = None
    """Reference of the phase: the force while a part is held, otherwise the position x."""
    current: float | None = None
    """Actual value of the quantity whose reference is ``target``."""
    unit: str = ""
    """Unit of ``target`` and ``current``: mN or µm."""
    instruction: str = ""
    """Task that a person must do before the action ``continue``; empty if the job does not wait for
    one.
    """
    weight_mN: float | None = None
    """Weight that a person must hang on the arm before the action ``continue``."""


class Job(Model):
    """A job: its request, its progress, and its result."""

    model_config = example(
        id="20260301-120000-1f0c",
        kind="grip",
        rig="demo",
        state="running",
        revision=5,
        position=None,
        cause="",
        ending=None,
        request={"kind": "grip", "autostart": True},
        values={"force_mN": 20.0, "hold_s": 4.0},
        sample="B7",
        batch="",
        operator="Ada",
        notes="",
        labels={},
        pinned=False,
        by="cell-7",
        traceparent="00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
        progress=None,
        recovery=None,
        approval_until=None,
        result=None,
        actions=[],
        allowed_actions=["pause", "stop", "abort", "release"],
        created_at="2026-03-01T12:00:00.000Z",
        started_at="2026-03-01T12:00:00.210Z",
        ended_at=None,
        record=None,
        artifacts="none",
        record_complete=None,
        record_detail="",
    )

    id: str
    kind: str
    rig: str
    state: JobState
    revision: int = 0
    """Revision number. It increases with every change except progress; the ETag contains it."""
    position: int | None = None
    """Position in the queue, 1 for the next job; null if the job does not wait for another one."""
    cause: str
    """Reason why the job did not succeed, as text."""
    ending: Ending | None = None
    """Reason for the end of the job, as a code with numbers; null before its end."""
    request: dict[str, Any]
    """The request as it was sent."""
    values: dict[str, Any]
    """Parameters that the job uses: the request completed from the rig file. A null ``hold_s``
    means a hold without an end.
    """
    sample: str = ""
    batch: str = ""
    operator: str = ""
    notes: str = ""
    labels: dict[str, str]
    pinned: bool = False
    """True if the record is kept regardless of the age and size limits in the rig file."""
    by: str | None = None
    """Client that requested the job: the name of a key with the caller's label in brackets; without
    keys, the header ``X-Operator`` or the client's address."""
    traceparent: str | None = None
    """W3C trace context of the request, from its header ``traceparent``; null without one."""
    progress: Progress | None
    recovery: RecoveryWait | None = None
    """Decision for which the job waits in the state ``awaiting_recovery``; null otherwise."""
    approval_until: str | None = None
    """Time, in UTC, at which a job in the state ``proposed`` ends unless it is approved; null in
    other states.
    """
    result: dict[str, Any] | None
    """Result of a job that has moved the arm; its members depend on the kind. For an interrupted
    job it contains the members common to all kinds, as far as the record allows.
    """
    actions: list[Action]
    allowed_actions: list[ActionType]
    created_at: str
    """Time of the request, in UTC; a queued job may start much later."""
    started_at: str | None
    """Time at which the job began to run, in UTC; null before."""
    ended_at: str | None
    """Time at which the job ended, in UTC; null before."""
    record: str | None
    """Folder of the record on the supervisor's computer."""
    artifacts: ArtifactState = "none"
    """State of the record's files. They are written after the end of the job; the rig can run
    another job meanwhile.
    """
    record_complete: bool | None = None
    """True if the record contains every sample of the job; null while it is being written, or if
    there is none.
    """
    record_detail: str = ""
    """Reason why the record is incomplete; empty if it is complete."""


class StoppedRequest(Model):
    """Result of stopping a request by its idempotency key."""

    model_config = example(job=None)

    job: Job | None
    """Job that the request had created, now stopped unless it had already ended. Null if there is
    no job; the request will not create one.
    """


class JobList(Model):
    """Jobs, newest first."""

    model_config = example(jobs=[], next=None)

    jobs: list[Job]
    next: str | None = None
    """Value of ``before`` for the next page; null at the end."""


class Artifact(Model):
    """A file of a record."""

    model_config = example(
        name="samples.parquet",
        media_type="application/vnd.apache.parquet",
        bytes=70211,
        sha256="9f…",
    )

    name: str
    media_type: str
    bytes: int
    sha256: str


class ArtifactList(Model):
    """Files of a record."""

    model_config = example(artifacts=[])

    artifacts: list[Artifact]
