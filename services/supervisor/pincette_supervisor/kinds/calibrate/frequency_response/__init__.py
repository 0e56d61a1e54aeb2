"""Calibration ``frequency_response``."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, Variant
from pincette.api.requests import Positive
from pincette.control.planning.calibration_programs import (
    LEAST_CAPTURE_HZ,
    SWEEP_FROM_HZ,
    SWEEP_S,
    SWEEP_TO_HZ,
)
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest

Frequency = Annotated[float, Field(ge=0.1, le=5000)]


class FrequencyResponseRequest(CalibrationRequest, frozen=True):
    """Sweep a sine through the resonance, acquired from the sensor's buffer; the part away."""

    model_config = example(
        kind="calibrate", calibration="frequency_response", autostart=True, to_hz=800.0
    )

    calibration: Literal["frequency_response"]
    from_hz: Frequency = SWEEP_FROM_HZ
    """Lowest frequency."""
    to_hz: Frequency = SWEEP_TO_HZ
    """Highest frequency."""
    duration_s: Annotated[float, Field(ge=1, le=120)] = SWEEP_S
    """Time of the measurement."""
    amplitude_V: Positive | None = None
    """Left out, as large as limits and resonance bear."""
    capture_hz: Annotated[float, Field(ge=LEAST_CAPTURE_HZ, le=100_000)] = LEAST_CAPTURE_HZ
    """Rate of the sweep's wave and of its acquisition."""

    @model_validator(mode="after")
    def _ascending(self) -> "FrequencyResponseRequest":
        if self.from_hz >= self.to_hz:
            raise ValueError(f"from_hz = {self.from_hz} Hz is not below to_hz = {self.to_hz} Hz")
        return self


CALIBRATION = Variant(
    name="frequency_response",
    label="frequency response",
    summary="Natural frequency and damping of the arm, by a sweep; take the part away.",
    request=FrequencyResponseRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="duration_s", label="For"),
        FieldSpec(name="from_hz", label="From"),
        FieldSpec(name="to_hz", label="To"),
        FieldSpec(
            name="amplitude_V",
            label="Amplitude",
            placeholder="as limits and resonance allow",
            advanced=True,
        ),
        FieldSpec(name="capture_hz", label="Acquired at", advanced=True),
    ),
    functions="pincette_supervisor.kinds.calibrate.frequency_response.functions:FUNCTIONS",
    place=40,
)
