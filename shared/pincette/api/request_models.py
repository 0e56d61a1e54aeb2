"""What may be asked for as a job; units are in the names, unknown fields are refused."""

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, Field, model_validator

from pincette.api.calibration_requests import AnyCalibrationRequest, CalibrationBody
from pincette.api.job_models import example
from pincette.api.motion_requests import (
    AnyMotionRequest,
    HoldJobRequest,
    MoveJobRequest,
    ReleaseJobRequest,
)
from pincette.api.request_base import (
    Duration,
    NotNegative,
    PolicyRequest,
    Positive,
    Speed,
)
from pincette.control.laws.law import ForceAge, ParameterSet, Scheme
from pincette.control.planning.paths import Shape

Gain = Annotated[float, Field(ge=0, le=1e9)]
PositiveGain = Annotated[float, Field(gt=0, le=1e9)]
LEVELS_MAX, POINTS_MAX = 100, 200


class Gains(BaseModel):
    """Gains that replace those of the rig file; K_S in mN, delta in µm (PBSMIC) or mN (DSMIFC)."""

    model_config = example(K_P=0.5, K_f=4000.0)

    K_P: Gain | None = None
    K_I: PositiveGain | None = None
    K_S: Gain | None = None
    delta: PositiveGain | None = None
    M: Gain | None = None
    B: Gain | None = None
    K: PositiveGain | None = None
    K_f: Gain | None = None
    force_age: ForceAge | None = None


def _apart(value: object) -> object:
    """Gains by themselves, so that a fault of theirs is not told as a fault of ``tuned`` too."""
    if isinstance(value, dict):
        return Gains.model_validate(value)
    if value is None or value == "tuned" or isinstance(value, Gains):
        return value
    raise ValueError(f'gains = {value!r:.60}: input should be "tuned", or gains by their names')


class JobRequest(PolicyRequest):
    """What every job that meets a part may say; what is left out comes from the rig file."""

    load_s: Duration | None = None
    approach_um_per_s: Speed | None = None
    seek_um_per_s: Speed | None = None
    contact_force_mN: Positive | None = None
    scheme: Scheme | None = None
    """Of the law: PBSMIC or DSMIFC."""
    set: ParameterSet | None = None
    """Whose m, b, k, d the law works with: the rig's (consistent) or the paper's (printed)."""
    gains: Annotated[Gains | Literal["tuned"] | None, BeforeValidator(_apart)] = None
    """What differs from the rig file's gains, or the balanced ones of a search on its model."""


class GripJobRequest(JobRequest):
    """Grip a part; what is left out comes from the rig file."""

    model_config = example(kind="grip", autostart=True, force_mN=20.0, labels={"part": "bead 12"})

    kind: Literal["grip"]
    force_mN: Positive | None = None
    hold_s: Duration | None = None
    until_released: bool = False
    """Hold until the action ``release``; excludes ``hold_s``."""

    @model_validator(mode="after")
    def _one_hold(self) -> "GripJobRequest":
        if self.until_released and self.hold_s is not None:
            raise ValueError(
                f"hold_s = {self.hold_s} s and until_released = true exclude each other: "
                "leave one out"
            )
        return self


class TrackPoint(BaseModel):
    """A force at a time since the begin of the path."""

    model_config = example(t_s=1.0, force_mN=12.0)

    t_s: NotNegative
    force_mN: NotNegative


class TrackJobRequest(JobRequest):
    """Grip a part and let position and force follow a path; what is left out is as in the rig file.

    A sinusoid and a triangle have a mean, a height, a frequency and cycles; steps have levels and
    a dwell; waypoints have points.
    """

    model_config = example(
        kind="track", autostart=True, shape="sinusoid", force_pp_mN=20.0, frequency_hz=0.5, cycles=5
    )

    kind: Literal["track"]
    shape: Shape | None = None
    force_mean_mN: Positive | None = None
    force_pp_mN: Positive | None = None
    """Peak to peak."""
    x_pp_um: Positive | None = None
    """Instead of ``force_pp_mN``, which is then K_e of the rig file's part times it."""
    frequency_hz: Positive | None = None
    cycles: int | None = Field(default=None, ge=1, le=1000)
    """At full amplitude; one more before and one after blend in and out."""
    levels_mN: list[NotNegative] | None = Field(default=None, min_length=1, max_length=LEVELS_MAX)
    dwell_s: Duration | None = None
    points: list[TrackPoint] | None = Field(default=None, min_length=2, max_length=POINTS_MAX)
    """The first at 0 s."""
    rate_um_per_s: Speed | None = None
    """Highest speed of x_r along the path; steps use it up."""
    acceleration_um_per_s2: Positive | None = None
    """Highest acceleration of x_r along the path; steps and corners use it up."""

    @model_validator(mode="after")
    def _one_height(self) -> "TrackJobRequest":
        if self.force_pp_mN is not None and self.x_pp_um is not None:
            raise ValueError(
                f"force_pp_mN = {self.force_pp_mN} mN and x_pp_um = {self.x_pp_um} µm exclude "
                "each other: one follows from the other, leave one out"
            )
        return self


LawJobRequest = GripJobRequest | TrackJobRequest
"""Jobs whose law may be chosen."""
AnyJobRequest = LawJobRequest | AnyMotionRequest | AnyCalibrationRequest
Body = Annotated[
    GripJobRequest
    | TrackJobRequest
    | MoveJobRequest
    | HoldJobRequest
    | ReleaseJobRequest
    | CalibrationBody,
    Field(discriminator="kind"),
]
"""A job request as it comes over REST; ``kind`` says which."""
