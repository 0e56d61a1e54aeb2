"""``calibrate``: identify quantities of the rig; each calibration is registered separately."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import WHOLE
from pincette.api.calibrations import CalibrationPlan, CalibrationResult
from pincette.api.job_kinds import JobKind, ResultField, Variant, registered
from pincette.api.requests import ZeroingRequest
from pincette.core import plugins

TRIES = 3


class CalibrationRequest(ZeroingRequest, frozen=True):
    """Members of every request for a calibration."""

    kind: Literal["calibrate"] = "calibrate"
    calibration: str
    arm: Literal[1, 2] = 1
    """Number of the arm to calibrate on a rig with two driven arms; the other arm rests."""
    tries: Annotated[int, Field(ge=1, le=10), WHOLE] = TRIES
    """Largest number of attempts if stalls trip the job; the request acknowledges these trips in
    advance."""


KIND = JobKind(
    name="calibrate",
    label="Calibrate",
    summary="Calibrate one quantity of the rig. The result is used once it is accepted.",
    request=CalibrationRequest,
    plan=CalibrationPlan,
    result=CalibrationResult,
    functions="pincette_supervisor.kinds.calibrate.functions:FUNCTIONS",
    figures=(
        ResultField(name="calibration", label="calibration"),
        ResultField(name="statement", label="finding"),
    ),
    variant_field="calibration",
    variants=registered(plugins.CALIBRATIONS, Variant),
    waits=True,
    proposes=True,
    picture="calibration.png",
    arms=(1, 2),
    on_stop="retract",
    # A calibration takes minutes, and a stall of the machine must not end it.
    lease_factor=3.0,
    needs_every_sample=True,
    place=60,
)
