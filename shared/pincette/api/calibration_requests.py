"""What may be asked for as a calibration; units are in the names, unknown fields are refused."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pincette.api.job_models import example
from pincette.api.request_base import (
    Duration,
    NotNegative,
    Positive,
    Speed,
    StartRequest,
)
from pincette.control.planning.calibration_programs import (
    LEAST_CAPTURE_HZ,
    NOISE_S,
    SWEEP_FROM_HZ,
    SWEEP_S,
    SWEEP_TO_HZ,
)

WEIGHTS_MN = (0.0, 5.0, 10.0, 20.0)
WEIGHTS_MAX, LEVELS_MAX = 20, 12
Frequency = Annotated[float, Field(ge=0.1, le=5000)]


class CalibrationRequest(StartRequest):
    """What every calibration may say."""

    kind: Literal["calibrate"] = "calibrate"


class NoiseRequest(CalibrationRequest):
    """Hold the voltage and read: noise, resolution and drift of the sensor."""

    model_config = example(kind="calibrate", calibration="noise", autostart=True)

    calibration: Literal["noise"]
    duration_s: Annotated[float, Field(ge=2, le=600)] = NOISE_S


class FreeResponseRequest(CalibrationRequest):
    """Move the free arm by voltage alone: gain, loop, creep and the model of both; the part away.

    What is left out comes from the rig file's limits and its nominal gain.
    """

    model_config = example(kind="calibrate", calibration="free_response", autostart=True)

    calibration: Literal["free_response"]
    low_V: float | None = None
    high_V: float | None = None
    """Voltages that a grip needs lie between both."""
    rate_V_per_s: Positive | None = None
    """Peak rate of the fastest moves."""

    @model_validator(mode="after")
    def _ordered(self) -> "FreeResponseRequest":
        if self.low_V is not None and self.high_V is not None and self.low_V >= self.high_V:
            raise ValueError(f"low_V = {self.low_V} V is not below high_V = {self.high_V} V")
        return self


class ComplianceRequest(CalibrationRequest):
    """Hang known weights at the tip, there and back, as the job asks for them; the part away."""

    model_config = example(
        kind="calibrate", calibration="compliance", autostart=True, weights_mN=[0.0, 5.0, 10.0]
    )

    calibration: Literal["compliance"]
    weights_mN: list[NotNegative] = Field(
        default=list(WEIGHTS_MN), min_length=2, max_length=WEIGHTS_MAX
    )
    """Ascending from 0; they pull as a part presses, against the closing of the gripper."""
    weight_uncertainty: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Of the weights, standard, as a share that is common to all of them."""


class ContactStiffnessRequest(CalibrationRequest):
    """Press the part by a sinusoid of voltage at several levels, as in Fig. 8 of the paper."""

    model_config = example(
        kind="calibrate", calibration="contact_stiffness", autostart=True, levels_V=[0.3, 1.0, 1.5]
    )

    calibration: Literal["contact_stiffness"]
    levels_V: list[Positive] | None = Field(default=None, min_length=3, max_length=LEVELS_MAX)
    """Peak to peak; left out, the paper's, scaled down to what the limits of the rig allow."""
    load_s: Duration | None = None
    """To press to the mean, and to let go again."""
    approach_um_per_s: Speed | None = None
    seek_um_per_s: Speed | None = None
    contact_force_mN: Positive | None = None


class FrequencyResponseRequest(CalibrationRequest):
    """Sweep a sine through the resonance, acquired from the sensor's buffer; the part away."""

    model_config = example(
        kind="calibrate", calibration="frequency_response", autostart=True, to_hz=800.0
    )

    calibration: Literal["frequency_response"]
    from_hz: Frequency = SWEEP_FROM_HZ
    to_hz: Frequency = SWEEP_TO_HZ
    duration_s: Annotated[float, Field(ge=1, le=120)] = SWEEP_S
    amplitude_V: Positive | None = None
    """Left out, as large as limits and resonance bear."""
    capture_hz: Annotated[float, Field(ge=LEAST_CAPTURE_HZ, le=100_000)] = LEAST_CAPTURE_HZ
    """Rate of the sweep's wave and of its acquisition."""

    @model_validator(mode="after")
    def _ascending(self) -> "FrequencyResponseRequest":
        if self.from_hz >= self.to_hz:
            raise ValueError(f"from_hz = {self.from_hz} Hz is not below to_hz = {self.to_hz} Hz")
        return self


AnyCalibrationRequest = (
    NoiseRequest
    | FreeResponseRequest
    | ComplianceRequest
    | ContactStiffnessRequest
    | FrequencyResponseRequest
)
CalibrationBody = Annotated[AnyCalibrationRequest, Field(discriminator="calibration")]
"""A calibration as it comes over REST; ``calibration`` says which."""
