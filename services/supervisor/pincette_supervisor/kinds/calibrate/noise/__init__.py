"""Calibration ``noise``."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, Variant
from pincette.control.planning.calibration_programs import NOISE_S
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest


class NoiseRequest(CalibrationRequest, frozen=True):
    """Hold the voltage and read: noise, resolution and drift of the sensor."""

    model_config = example(kind="calibrate", calibration="noise", autostart=True)

    calibration: Literal["noise"]
    duration_s: Annotated[float, Field(ge=2, le=600)] = NOISE_S
    """Time of the measurement."""


CALIBRATION = Variant(
    name="noise",
    label="noise of the sensor",
    summary="Noise, resolution and drift of the sensor, the arm at rest.",
    request=NoiseRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="duration_s", label="For"),
    ),
    functions="pincette_supervisor.kinds.calibrate.noise.functions:FUNCTIONS",
    place=10,
)
