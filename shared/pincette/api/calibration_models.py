"""What a calibration looks like over REST before it is decided about: its plan and its result."""

from typing import Any, Literal

from pydantic import BaseModel

from pincette.api.job_models import example
from pincette.api.plan_models import Law, Violation
from pincette.api.prediction_models import Prediction
from pincette.api.result_models import ActionTaken, LimitActed, Phase

CalibrationName = Literal[
    "noise", "free_response", "compliance", "contact_stiffness", "frequency_response"
]


class CalibrationPhase(BaseModel):
    """A phase as planned; the voltage is that at its end."""

    model_config = example(
        phase="hang 2",
        start_s=2.5,
        duration_s=None,
        voltage_V=0.0,
        instruction="hang 5 mN on the tip, then POST the action continue",
    )

    phase: str
    start_s: float
    """Waiting not counted."""
    duration_s: float | None
    """Null where it waits for a person."""
    voltage_V: float
    instruction: str = ""


class CalibrationPlan(BaseModel):
    """What a calibration would do, and whether it may; voltages are foretold by d_p alone."""

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
        rests_on=[],
        law=None,
    )

    kind: Literal["calibrate"] = "calibrate"
    calibration: CalibrationName
    rig: str
    feasible: bool
    duration_s: float
    """Waiting not counted."""
    waits: int
    """How often it waits for a person."""
    phases: list[CalibrationPhase]
    voltage_min_V: float
    voltage_max_V: float
    violations: list[Violation]
    rests_on: list["RestsOn"]
    law: Law | None
    """Where the arm is led by one on its way to the part."""
    prediction: Prediction | None = None
    """What playing it on the model in use foretells; null where that was not asked for."""


class RestsOn(BaseModel):
    """A quantity that a calibration takes for granted."""

    model_config = example(
        quantity="model.compliance_um_per_mN", value=0.46, unit="µm/mN", source="assumed"
    )

    quantity: str
    value: Any
    unit: str
    source: str
    """``assumed``, or the calibration it comes from."""


class Identified(BaseModel):
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


class Figure(BaseModel):
    """Something else that the measurement says; it changes nothing."""

    model_config = example(
        name="loop", value=18.4, unit="%", meaning="largest width, of the stroke"
    )

    name: str
    value: float
    unit: str
    meaning: str


class Residuals(BaseModel):
    """What the fit has left."""

    model_config = example(of="position", unit="µm", rms=0.018, maximum=0.031, count=7)

    of: str
    unit: str
    rms: float
    maximum: float
    """Of the magnitude."""
    count: int


class CalibrationResult(BaseModel):
    """What came of a calibration; without values where it did not come that far."""

    model_config = example(
        outcome="moved",
        calibration="compliance",
        values=[],
        figures=[],
        residuals=None,
        statement="…",
        warnings=[],
        rests_on=[],
        phases=[],
        limits_acted=[],
        actions=[],
        samples=1250,
        missed_ticks=0,
        unanswered_ticks=0,
        dropped_messages=0,
    )

    outcome: str
    """moved, stopped, no_contact, overforce, zero_refused, tripped, or unfinished."""
    calibration: CalibrationName
    values: list[Identified]
    figures: list[Figure]
    residuals: Residuals | None
    statement: str
    """How sure the values are, in words; or why there are none."""
    warnings: list[str]
    rests_on: list[RestsOn]
    phases: list[Phase]
    limits_acted: list[LimitActed]
    actions: list[ActionTaken]
    samples: int
    missed_ticks: int
    """Samples that were never taken or never came here."""
    unanswered_ticks: int
    """Ticks for which the actuator took no command."""
    dropped_messages: int


CalibrationPlan.model_rebuild()
