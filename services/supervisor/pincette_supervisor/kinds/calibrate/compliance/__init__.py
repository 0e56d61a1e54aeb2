"""Calibration ``compliance``."""

from typing import Annotated, Literal

from pydantic import Field

from pincette.api import Model, example
from pincette.api.job_kinds import FieldSpec, Variant
from pincette.api.requests import NotNegative
from pincette_supervisor.kinds import fields
from pincette_supervisor.kinds.calibrate.request import CalibrationRequest

WEIGHTS_MAX = 20


class WeighedStep(Model):
    """Readings under one weight."""

    model_config = example(x_um=-2.31, scatter_um=0.004, at_s=-41.5)

    x_um: float
    scatter_um: NotNegative
    """Standard uncertainty of the mean."""
    at_s: float
    """Since the job began; below 0 s of a reading before it."""


class ComplianceRequest(CalibrationRequest, frozen=True):
    """Hang known weights at the tip, there and back, as the job asks for them; the part away."""

    model_config = example(
        kind="calibrate", calibration="compliance", autostart=True, weights_mN=[0.0, 5.0, 10.0]
    )

    calibration: Literal["compliance"]
    weights_mN: list[NotNegative] | None = Field(default=None, min_length=2, max_length=WEIGHTS_MAX)
    """Ascending from 0; they pull as a part presses, against the closing of the gripper. Left out,
    three round weights that the limits of the rig bear."""
    weight_uncertainty: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Standard uncertainty of the weights, as a share common to all of them."""
    taken: list[WeighedStep] = Field(default_factory=list[WeighedStep], max_length=2 * WEIGHTS_MAX)
    """The first steps, as a job has read them that a stall has tripped; this one goes on."""


CALIBRATION = Variant(
    name="compliance",
    label="compliance, with weights",
    summary="Compliance of the arm by known weights, hung as it asks for them; take the part away.",
    request=ComplianceRequest,
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(name="weights_mN", label="Weights, from 0", placeholder="as the limits allow"),
        FieldSpec(
            name="weight_uncertainty", label="Uncertainty of the weights, as a share", advanced=True
        ),
    ),
    functions="pincette_supervisor.kinds.calibrate.compliance.functions:FUNCTIONS",
    place=20,
)
