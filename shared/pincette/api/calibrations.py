"""Calibrations over REST: plan, result, and proposal."""

from typing import Any, Literal

from pincette.api import Model, example
from pincette.api.plans import JobPlan, Law
from pincette.api.results import JobResult


class Assumption(Model):
    """A quantity that a calibration assumes."""

    model_config = example(
        quantity="model.compliance_um_per_mN", value=0.46, unit="µm/mN", source="assumed"
    )

    quantity: str
    value: Any
    unit: str
    source: str
    """``assumed``, or the calibration that found the value."""


class CalibrationPlan(JobPlan):
    """Plan of a calibration, and whether it may start. The voltages depend on d_p alone."""

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
    """Number of times that the calibration waits for a person."""
    voltage_min_V: float
    voltage_max_V: float
    assumptions: list[Assumption]
    law: Law | None
    """Law that moves the arm to the part; null if the calibration uses no law."""


class Identified(Model):
    """Value that a calibration has found for a quantity in the rig file."""

    model_config = example(
        quantity="model.compliance_um_per_mN", value=0.4583, unit="µm/mN", uncertainty=0.0011
    )

    quantity: str
    value: Any
    """Value: a number, or a table of numbers."""
    unit: str
    uncertainty: float | None
    """Standard uncertainty (one sigma); null if it cannot be stated as one number."""


class Figure(Model):
    """Additional result of the measurement, which changes no value in use."""

    model_config = example(
        name="loop", value=18.4, unit="%", meaning="largest width as a share of the stroke"
    )

    name: str
    value: float
    unit: str
    meaning: str


class Residuals(Model):
    """Residuals of the fit."""

    model_config = example(of="position", unit="µm", rms=0.018, maximum=0.031, count=7)

    of: str
    unit: str
    rms: float
    maximum: float
    """Largest magnitude of a residual."""
    count: int


class CalibrationResult(JobResult):
    """Result of a calibration; without values if it ended too early."""

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
    """Certainty of the values as text, or the reason why there are none."""
    warnings: list[str]
    assumptions: list[Assumption]


ProposalState = Literal["proposed", "accepted", "discarded", "superseded"]


class ProposedValue(Identified):
    """Proposed value and the value in use.

    After the decision, ``in_use`` remains the value that was in use before.
    """

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
    """``assumed``, or the calibration that found the value in use."""
    difference: float | None
    """Proposed value minus the value in use; null if it is not a number."""
    difference_percent: float | None


class Proposal(Model):
    """Values that a calibration proposes. Nothing changes until they are accepted."""

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
    """Identifier of the calibration's job."""
    calibration: str
    rig: str
    state: ProposalState
    """State of the proposal; ``superseded`` means that a later proposal of the same kind was
    accepted.
    """
    made_at: str
    decided_at: str | None
    model_version: int | None
    """Version of the model that was created when the proposal was accepted."""
    values: list[ProposedValue]
    figures: list[Figure]
    residuals: Residuals | None
    statement: str
    """Certainty of the values as text."""
    warnings: list[str]
    assumptions: list[Assumption]
    made_with: dict[str, Any]
    """Version and digest of the model that was in use during the measurement."""
    job: str
    plot: str
    allowed_actions: list[Literal["accept", "discard"]]


class ProposalList(Model):
    """Proposals, newest first."""

    model_config = example(calibrations=[], next=None)

    calibrations: list[Proposal]
    next: str | None = None
    """Value of ``before`` for the next page; null at the end."""


class ProposalAction(Model):
    """Accept or discard a proposal."""

    model_config = example(type="accept")

    type: Literal["accept", "discard"]
