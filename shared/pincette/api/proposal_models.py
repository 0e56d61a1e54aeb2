"""What a proposal and a model look like over REST."""

from typing import Any, Literal

from pydantic import BaseModel, Field

from pincette.api.calibration_models import (
    CalibrationName,
    Figure,
    Identified,
    Residuals,
    RestsOn,
)
from pincette.api.job_models import example

ProposalState = Literal["proposed", "accepted", "discarded", "superseded"]


class ProposedValue(Identified):
    """A value beside the one in use; of one decided about, the one in use until then."""

    model_config = example(
        quantity="model.compliance_um_per_mN",
        value=0.4583,
        unit="µm/mN",
        uncertainty=0.0011,
        in_use=0.46,
        source_in_use="assumed",
        difference=-0.0017,
        difference_percent=-0.37,
    )

    in_use: Any
    source_in_use: str
    """``assumed``, or the calibration it comes from."""
    difference: float | None
    """Proposed less in use; null of what is no number."""
    difference_percent: float | None


class Proposal(BaseModel):
    """What a calibration proposes; nothing changes until it is accepted."""

    model_config = example(
        id="20260301-120000-1f0c",
        calibration="compliance",
        rig="demo",
        state="proposed",
        made_at="2026-03-01T12:01:10.000Z",
        decided_at=None,
        model_version=None,
        values=[],
        figures=[],
        residuals=None,
        statement="…",
        warnings=[],
        rests_on=[],
        made_with={"version": 0, "digest": ""},
        job="/api/v1/jobs/20260301-120000-1f0c",
        plot="/api/v1/jobs/20260301-120000-1f0c/artifacts/calibration.png",
        allowed_actions=["accept", "discard"],
    )

    id: str
    """That of its job."""
    calibration: CalibrationName
    rig: str
    state: ProposalState
    """superseded: another proposal of its kind was accepted since."""
    made_at: str
    decided_at: str | None
    model_version: int | None
    """Version that it was accepted as."""
    values: list[ProposedValue]
    figures: list[Figure]
    residuals: Residuals | None
    statement: str
    """How sure the values are, in words."""
    warnings: list[str]
    rests_on: list[RestsOn]
    made_with: dict[str, Any]
    """Version and digest of the model that was in use while it was measured."""
    job: str
    plot: str
    allowed_actions: list[Literal["accept", "discard"]]


class ProposalList(BaseModel):
    """Proposals, the newest first."""

    model_config = example(calibrations=[])

    calibrations: list[Proposal]


class ProposalAction(BaseModel):
    """What shall become of a proposal."""

    model_config = example(type="accept")

    type: Literal["accept", "discard"]


class ModelQuantity(BaseModel):
    """A quantity that calibrations can find, as it is in use."""

    model_config = example(
        quantity="model.compliance_um_per_mN",
        value=0.4583,
        unit="µm/mN",
        source="20260301-120000-1f0c",
        uncertainty=0.0011,
        accepted_at="2026-03-01T12:02:00.000Z",
        due_at="2026-08-28T12:01:10.000Z",
        overdue=False,
        serial_numbers={"sensor": "1540122", "output": "A-0311"},
    )

    quantity: str
    value: Any
    """Null where the rig file has none."""
    unit: str
    source: str
    """``assumed``, or the calibration it comes from."""
    uncertainty: float | None
    """Standard; null of what is assumed."""
    accepted_at: str | None
    """Null of what is assumed."""
    due_at: str | None
    """When it is to be measured again; null: never by itself."""
    overdue: bool
    serial_numbers: dict[str, str]
    """Of the instruments it was measured with, by table of the rig file; those that are known."""


class ModelVersion(BaseModel):
    """A version that was accepted."""

    model_config = example(
        version=1,
        digest="3f2a9d1c0b7e6655",
        made_at="2026-03-01T12:02:00.000Z",
        quantities=["model.compliance_um_per_mN"],
        previous="",
        trouble="",
    )

    version: int
    digest: str
    made_at: str
    quantities: list[str]
    previous: str
    """Digest of the model that was in use before; empty: that of the rig file."""
    trouble: str
    """Why it is not used without a person's word; empty where it can be."""


class ModelView(BaseModel):
    """The model in use, and the versions there are."""

    model_config = example(
        rig="demo",
        version=1,
        digest="3f2a9d1c0b7e6655",
        rig_file_digest="9f31c2a4550b7e66",
        trouble="",
        quantities=[],
        versions=[],
    )

    rig: str
    version: int
    """0: the rig file alone."""
    digest: str
    rig_file_digest: str
    trouble: str
    """Why the model of before a restart is not in use; empty where nothing is the matter."""
    quantities: list[ModelQuantity]
    versions: list[ModelVersion]


class ModelAction(BaseModel):
    """Use a version, or with 0 the rig file alone."""

    model_config = example(type="use", version=1)

    type: Literal["use"]
    version: int = Field(ge=0, le=9999)
