"""What a job looks like over REST; units are in the names, unknown fields are refused."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from pincette_supervisor.states import ActionType, JobState

Positive = Annotated[float, Field(gt=0)]
Duration = Annotated[float, Field(gt=0, le=3600)]
Speed = Annotated[float, Field(ge=0.1, le=1000)]
Label = Annotated[str, Field(max_length=200)]
LabelName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,40}$")]


def example(**values: Any) -> ConfigDict:
    """Settings of every REST model, with its example for the OpenAPI document."""
    return ConfigDict(
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        frozen=True,
        json_schema_extra={"examples": [values]},
    )


class GripJobRequest(BaseModel):
    """Grip a part; what is left out comes from the rig file."""

    model_config = example(kind="grip", autostart=True, force_mN=20.0, labels={"part": "bead 12"})

    kind: Literal["grip"]
    autostart: bool = False
    """Begin as soon as the job is ready, without the action ``start``."""
    dry_run: bool = False
    """Plan and predict only; no job is made."""
    rig: str | None = Field(default=None, max_length=40)
    """Name of the rig; may be left out where there is one."""
    force_mN: Positive | None = None
    hold_s: Duration | None = None
    until_released: bool = False
    """Hold until the action ``release``; excludes ``hold_s``."""
    load_s: Duration | None = None
    approach_um_per_s: Speed | None = None
    seek_um_per_s: Speed | None = None
    contact_force_mN: Positive | None = None
    labels: dict[LabelName, Label] = Field(default_factory=dict, max_length=16)

    @model_validator(mode="after")
    def _one_hold(self) -> "GripJobRequest":
        if self.until_released and self.hold_s is not None:
            raise ValueError(
                f"hold_s = {self.hold_s} s and until_released = true exclude each other: "
                "leave one out"
            )
        return self


class ActionRequest(BaseModel):
    """What a job shall do."""

    model_config = example(type="stop")

    type: ActionType


class Action(BaseModel):
    """An action that was asked for, kept with its job."""

    model_config = example(
        type="release", requested_at="2026-03-01T12:00:09.250Z", by="127.0.0.1", seq=462
    )

    type: ActionType
    requested_at: str
    by: str
    """Address it came from."""
    seq: int | None = None
    """Sample at which it took effect, once it has."""


class PlannedPhase(BaseModel):
    """A phase as planned; position, force and voltage at its end."""

    model_config = example(
        phase="load", start_s=6.85, duration_s=2.0, x_um=39.22, force_mN=20.0, voltage_V=2.55
    )

    phase: str
    start_s: float
    duration_s: float
    x_um: float
    force_mN: float
    voltage_V: float


class Violation(BaseModel):
    """A limit that the plan breaks, where and when."""

    model_config = example(
        pointer="/force_mN",
        quantity="force",
        value=55.0,
        limit=40.0,
        unit="mN",
        at_s=8.85,
        message="force_mN = 55 mN is above the limit of 40 mN",
    )

    pointer: str
    """JSON pointer into the request."""
    quantity: str
    value: float
    limit: float
    unit: str
    at_s: float
    message: str


class Curves(BaseModel):
    """Predicted course, thinned out; lists of one length."""

    model_config = example(
        t_s=[0.0, 1.0], x_r_um=[0.0, 12.5], force_r_mN=[0.0, 0.0], voltage_V=[0.0, 0.66]
    )

    t_s: list[float]
    x_r_um: list[float]
    force_r_mN: list[float]
    voltage_V: list[float]


class Plan(BaseModel):
    """What a job would do, and whether it may."""

    model_config = example(
        kind="grip",
        rig="demo",
        feasible=True,
        duration_s=16.4,
        phases=[],
        violations=[],
        curves={"t_s": [0.0], "x_r_um": [0.0], "force_r_mN": [0.0], "voltage_V": [0.0]},
    )

    kind: Literal["grip"]
    rig: str
    feasible: bool
    duration_s: float
    """As planned; a hold without end counts little."""
    phases: list[PlannedPhase]
    violations: list[Violation]
    curves: Curves


class Progress(BaseModel):
    """Where a running job is, by its newest samples."""

    model_config = example(
        phase="hold",
        seq=445,
        elapsed_s=8.9,
        planned_s=16.4,
        x_um=39.9,
        force_mN=19.98,
        force_uncertainty_mN=0.41,
        voltage_V=2.49,
        held=True,
    )

    phase: str
    seq: int
    elapsed_s: float
    planned_s: float | None
    """None where the hold has no end."""
    x_um: float | None
    force_mN: float | None
    force_uncertainty_mN: float | None
    voltage_V: float | None
    held: bool


class Job(BaseModel):
    """A job: what was asked, how far it is, what came of it."""

    model_config = example(
        id="20260301-120000-1f0c",
        kind="grip",
        rig="demo",
        state="running",
        cause="",
        request={"kind": "grip", "autostart": True},
        values={"force_mN": 20.0, "hold_s": 4.0},
        labels={},
        progress=None,
        result=None,
        actions=[],
        allowed_actions=["stop", "abort", "release"],
        created_at="2026-03-01T12:00:00.000Z",
        started_at="2026-03-01T12:00:00.210Z",
        ended_at=None,
        record=None,
    )

    id: str
    kind: Literal["grip"]
    rig: str
    state: JobState
    cause: str
    """Why a job did not succeed, in words."""
    request: dict[str, Any]
    """As it was sent."""
    values: dict[str, Any]
    """What the job works with: the request completed by the rig file; hold_s null has no end."""
    labels: dict[str, str]
    progress: Progress | None
    result: dict[str, Any] | None
    """Of a job that has moved: see GripResult."""
    actions: list[Action]
    allowed_actions: list[ActionType]
    created_at: str
    started_at: str | None
    ended_at: str | None
    record: str | None
    """Folder of the record on the supervisor's machine."""


class JobList(BaseModel):
    """Jobs, the newest first."""

    model_config = example(jobs=[])

    jobs: list[Job]


class Artifact(BaseModel):
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


class ArtifactList(BaseModel):
    """Files of a record."""

    model_config = example(artifacts=[])

    artifacts: list[Artifact]
