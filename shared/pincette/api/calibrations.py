"""Calibrations over REST: plan, result, and proposal."""

from typing import Any, Literal

from pincette.api import Model, example
from pincette.api.plans import JobPlan, Law
from pincette.api.results import JobResult


class Assumption(Model):
    """A quantity that a calibration takes for granted."""

    model_config = example(
        quantity="model.compliance_um_per_mN", value=0.46, unit="µm/mN", source="assumed"
    )

    quantity: str
    value: Any
    unit: str
    source: str
    """``assumed``, or the calibration it comes from."""


class CalibrationPlan(JobPlan):
    """What a calibration would do, and whether it may; voltages are predicted by d_p alone."""

    model_config = example(
        kind="calibrate",
        calibration="noise",
        rig="demo",
        feasible=True,
        duration_s=8.0,
        waits=0,
        phases=[],
        voltage_min_V=0.0,
        voltage_max_V=0.0,
        violations=[],
        assumptions=[],
        law=None,
    )

    calibration: str
    waits: int
    """How often it waits for a person."""
    voltage_min_V: float
    voltage_max_V: float
    assumptions: list[Assumption]
    law: Law | None
    """Where one leads the arm to the part."""


class Identified(Model):
    """A value that a calibration has found for a quantity of the rig file."""

    model_config = example(
        quantity="model.compliance_um_per_mN", value=0.4583, unit="µm/mN", uncertainty=0.0011
    )

    quantity: str
    value: Any
    """A number, or a table of numbers."""
    unit: str
    uncertainty: float | None
    """Standard, one sigma; null where none can be stated in one number."""


class Figure(Model):
    """Something else that the measurement says; it changes nothing."""

    model_config = example(
        name="loop", value=18.4, unit="%", meaning="largest width, of the stroke"
    )

    name: str
    value: float
    unit: str
    meaning: str


class Residuals(Model):
    """What the fit has left."""

    model_config = example(of="position", unit="µm", rms=0.018, maximum=0.031, count=7)

    of: str
    unit: str
    rms: float
    maximum: float
    """Of the magnitude."""
    count: int


class CalibrationResult(JobResult):
    """What came of a calibration; without values where it did not come that far."""

    model_config = example(
        outcome="moved",
        calibration="compliance",
        values=[],
        figures=[],
        residuals=None,
        statement="…",
        warnings=[],
        assumptions=[],
        phases=[],
        limits_acted=[],
        actions=[],
        samples=1250,
        missed_ticks=0,
        unanswered_ticks=0,
        dropped_messages=0,
    )

    calibration: str
    values: list[Identified]
    figures: list[Figure]
    residuals: Residuals | None
    statement: str
    """How sure the values are, in words; or why there are none."""
    warnings: list[str]
    assumptions: list[Assumption]


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


class Proposal(Model):
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
        assumptions=[],
        made_with={"version": 0, "digest": ""},
        job="/api/v1/jobs/20260301-120000-1f0c",
        plot="/api/v1/jobs/20260301-120000-1f0c/artifacts/calibration.png",
        allowed_actions=["accept", "discard"],
    )

    id: str
    """That of its job."""
    calibration: str
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
    assumptions: list[Assumption]
    made_with: dict[str, Any]
    """Version and digest of the model that was in use while it was measured."""
    job: str
    plot: str
    allowed_actions: list[Literal["accept", "discard"]]


class ProposalList(Model):
    """Proposals, the newest first."""

    model_config = example(calibrations=[], next=None)

    calibrations: list[Proposal]
    next: str | None = None
    """Value of ``before`` for the proposals that follow; null where there are no more."""


class ProposalAction(Model):
    """What shall become of a proposal."""

    model_config = example(type="accept")

    type: Literal["accept", "discard"]
