"""``characterise``: measure what the data sheet of a gripper states."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import Model, example
from pincette.api.job_kinds import FieldSpec, JobKind, ResultField
from pincette.api.plans import Plan
from pincette.api.requests import ContactJobRequest, Positive
from pincette.api.results import COMMON, ClosedLoopResult
from pincette_supervisor.kinds import fields

NOISE_S = 60.0


class CharacteriseJobRequest(ContactJobRequest, frozen=True):
    """Measure the figures of a data sheet, with the part of the rig file in the gripper.

    First the free arm moves, as far as the part permits: by voltage, then under the law. Then it
    grips the part, several times. Amplitudes follow from the limits of the rig.
    """

    model_config = example(kind="characterise", autostart=True, force_mN=20.0)

    kind: Literal["characterise"]
    force_mN: Positive | None = None
    """Highest force on the part."""
    noise_s: Annotated[float, Field(ge=2, le=600)] = NOISE_S
    """Duration of each of the two measurements of the noise, of the free and of the holding arm."""
    grips: Annotated[int, Field(ge=1, le=50)] = 10
    """Number of grips over which the zero return is measured."""


Quantity = Literal[
    "free_stroke",
    "drive_gain",
    "hysteresis_open",
    "hysteresis_closed",
    "creep_open",
    "creep_closed",
    "position_noise_1_s",
    "position_noise_all",
    "position_resolution",
    "position_bandwidth",
    "position_phase",
    "position_rise",
    "position_settling",
    "position_overshoot",
    "force_noise_1_s",
    "force_noise_all",
    "force_resolution",
    "force_bandwidth",
    "force_phase",
    "force_rise",
    "force_settling",
    "force_uncertainty",
    "force_error",
    "contact_stiffness",
    "zero_return",
    "zero_return_scatter",
    "zero_return_worst",
    "grip_time",
    "arm_stiffness",
    "mode",
    "damping",
]
"""Quantity of a data sheet."""


class SheetValue(Model):
    """A value of a data sheet."""

    model_config = example(
        quantity="position_bandwidth",
        value=4.1,
        uncertainty=0.2,
        unit="Hz",
        bound="",
        source="measured",
        conditions={"amplitude_um": 1.0, "at_um": 12.0},
        paper=None,
    )

    quantity: Quantity
    value: float | None
    """Value; null if it was not reached within the measurement."""
    uncertainty: float | None
    """Expanded uncertainty with coverage factor 2; null if it is not known."""
    unit: str
    bound: Literal["", "above"] = ""
    """``above`` if the true value is larger: it is beyond what was measured."""
    source: str
    """``measured`` in this job, ``planned``, the calibration that found the value in use, or
    ``assumed``."""
    conditions: dict[str, float]
    """Conditions of the measurement, by names with units."""
    paper: float | None = None
    """Value of the same quantity in Q. Xu, IEEE T-ASE 10(3), 2013; null if it states none."""


class FrequencyPoint(Model):
    """Small-signal response at one frequency."""

    model_config = example(frequency_hz=1.0, gain=0.98, gain_uncertainty=0.01, phase_deg=-12.0)

    frequency_hz: float
    gain: float
    gain_uncertainty: float
    """Expanded uncertainty of the gain, with coverage factor 2."""
    phase_deg: float


class CharacteriseResult(ClosedLoopResult):
    """Values of a data sheet, and the small-signal responses behind its bandwidths."""

    model_config = example(
        outcome="tracked",
        phases=[{"phase": "hold", "start_s": 8.9, "duration_s": 4.0}],
        **COMMON,
        values=[],
        position_response=[],
        force_response=[],
    )

    values: list[SheetValue]
    position_response: list[FrequencyPoint]
    """Response of the position of the free arm to its reference."""
    force_response: list[FrequencyPoint]
    """Response of the force on the held part to its reference."""
    free_stroke_um: float | None = None
    position_bandwidth_hz: float | None = None
    """Frequency at which the gain of the position is -3 dB; null if it was not reached."""
    force_bandwidth_hz: float | None = None
    """Frequency at which the gain of the force is -3 dB; null if it was not reached."""


KIND = JobKind(
    name="characterise",
    label="Measure a data sheet",
    summary="Measure the figures of a data sheet, with the part of the rig file in the gripper.",
    request=CharacteriseJobRequest,
    plan=Plan,
    result=CharacteriseResult,
    functions="pincette_supervisor.kinds.characterise.functions:FUNCTIONS",
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="force_mN", label="Highest force", limit="force_max"),
        FieldSpec(name="noise_s", label="Measure noise for"),
        FieldSpec(name="grips", label="Grips for the zero return"),
        fields.CONDITION,
        *fields.LAW,
        *fields.POLICIES,
    ),
    figures=(
        ResultField(name="free_stroke_um", label="free stroke", unit="µm", main=True),
        ResultField(name="position_bandwidth_hz", label="position bandwidth", unit="Hz", main=True),
        ResultField(name="force_bandwidth_hz", label="force bandwidth", unit="Hz", main=True),
        *fields.CONTACT,
        *fields.ZERO_RETURN,
        *fields.POSITION_STEP,
    ),
    picture="datasheet.png",
    place=65,
)
