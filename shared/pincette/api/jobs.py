"""What a job looks like over REST; units are in the names, unknown fields are refused."""

from typing import Annotated, Any, Literal

from pydantic import Field

from pincette.api import Model, example
from pincette.api.endings import Ending
from pincette.api.requests import Label, Labels, Notes
from pincette.api.states import ActionType, JobState

ArtifactState = Literal["none", "being_written", "ready", "deleted"]


class ActionRequest(Model):
    """What a job shall do."""

    model_config = example(type="stop")

    type: ActionType


class StopRequest(Model):
    """Which request shall come to nothing, whether or not it has its job yet."""

    model_config = example(idempotency_key="cell 4, part 17")

    idempotency_key: Annotated[str, Field(min_length=1, max_length=255, pattern=r"^[ -~]+$")]
    """What it was sent with, or will be."""


class Action(Model):
    """An action that was asked for, kept with its job."""

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
    """Who asked, as ``by`` of a job."""
    applied_at: str | None = None
    """When the supervisor learned that it has taken effect."""
    seq: int | None = None
    """Sample at which it took effect, once it has."""


class JobEdit(Model):
    """What is said of a job, also after its end; what is left out stays as it is."""

    model_config = example(sample="B7", notes="bead with a chip", pinned=True)

    sample: Label | None = None
    batch: Label | None = None
    operator: Annotated[str, Field(max_length=80)] | None = None
    notes: Notes | None = None
    labels: Labels | None = None
    """In place of all that there are."""
    pinned: bool | None = None
    """Keep the record, whatever the rig file says of the age and the size of records."""


class Progress(Model):
    """Where a running job is, by its newest samples."""

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
    """Without pauses; None where the hold has no end."""
    paused: bool = False
    percent: float | None = None
    """Of the planned time that was played; None where the hold has no end."""
    remaining_s: float | None = None
    """Of the planned time; a pause leaves it as it is."""
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
    """When the hold begins, as planned; 0 while it lasts, null where none comes."""
    force_held_mN: float | None = None
    """Mean of the force in the hold, of both arms where there are two, without its first half
    second; null until then."""
    target: float | None = None
    """What the phase is about, as it should be: the force while a part is held, else x."""
    current: float | None = None
    """The same as it is."""
    unit: str = ""
    """Of ``target`` and ``current``: mN or µm."""
    instruction: str = ""
    """What a person is to do before the action ``continue``; empty where nothing is waited for."""
    weight_mN: float | None = None
    """The weight to be hung by then."""


class Job(Model):
    """A job: what was asked, how far it is, what came of it."""

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
        progress=None,
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
    """Rises with every change but progress; the ETag is made of it."""
    position: int | None = None
    """Place in the queue of a job that waits for another one: 1 is the next."""
    cause: str
    """Why a job did not succeed, in words."""
    ending: Ending | None = None
    """Why it has ended, as a code with numbers; null until then."""
    request: dict[str, Any]
    """As it was sent."""
    values: dict[str, Any]
    """What the job works with: the request completed by the rig file; hold_s null has no end."""
    sample: str = ""
    batch: str = ""
    operator: str = ""
    notes: str = ""
    labels: dict[str, str]
    pinned: bool = False
    """Whether its record stays, whatever the rig file says of the age and the size of records."""
    by: str | None = None
    """Who asked for it: the name of a key with the caller's label in brackets; without keys the
    header ``X-Operator``, or the address it came from."""
    progress: Progress | None
    result: dict[str, Any] | None
    """Of a job that has moved, by its kind; of one that was interrupted, as far as its record
    tells: the members that every result has."""
    actions: list[Action]
    allowed_actions: list[ActionType]
    created_at: str
    """Time of the request, in UTC; a queued job may start much later."""
    started_at: str | None
    """Time at which the job began to run, in UTC; null before."""
    ended_at: str | None
    """Time at which the job ended, in UTC; null before."""
    record: str | None
    """Folder of the record on the supervisor's machine."""
    artifacts: ArtifactState = "none"
    """Files of the record: written from the end on, while the rig is free for another job."""
    record_complete: bool | None = None
    """Whether the record has every sample of the job; None where it is not closed, or not made."""
    record_detail: str = ""
    """Why it is not complete."""


class StoppedRequest(Model):
    """What has become of a request that was stopped."""

    model_config = example(job=None)

    job: Job | None
    """The job that it had created, which has been stopped if it had not ended; null where there was
    none, and none will come."""


class JobList(Model):
    """Jobs, the newest first."""

    model_config = example(jobs=[], next=None)

    jobs: list[Job]
    next: str | None = None
    """What ``before`` must be for the jobs that follow; None where there are no more."""


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
