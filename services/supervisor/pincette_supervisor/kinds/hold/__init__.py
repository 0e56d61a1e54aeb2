"""``hold``: keep what is in the gripper, and let it go at the end."""

from typing import Literal

from pydantic import model_validator

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, JobKind
from pincette.api.plans import MotionPlan
from pincette.api.requests import Duration, PolicyRequest, check_one_hold
from pincette.api.results import MotionResult
from pincette_supervisor.kinds import fields


class HoldJobRequest(PolicyRequest, frozen=True):
    """Keep what is in the gripper by the voltage that is applied, and let it go at the end.

    For a part that is held when the job begins: after a trip and a reset, or after a stop. No law
    and no zero is needed; the limits of position are watched.
    """

    model_config = example(kind="hold", autostart=True, until_released=True)

    kind: Literal["hold"]
    hold_s: Duration | None = None
    """Left out: until the action ``release``."""
    until_released: bool = False
    """The same as no ``hold_s``; excludes it."""
    release_s: Duration | None = None
    """How long the way to the safe voltage takes; left out, as in a release."""

    @model_validator(mode="after")
    def _one_hold(self) -> "HoldJobRequest":
        check_one_hold(self.hold_s, until_released=self.until_released)
        return self


KIND = JobKind(
    name="hold",
    label="Hold a part",
    summary="Go on holding what is in the gripper, after a stop or a reset.",
    request=HoldJobRequest,
    plan=MotionPlan,
    result=MotionResult,
    functions="pincette_supervisor.kinds.hold.functions:FUNCTIONS",
    form=(
        FieldSpec(name="hold_s", label="Hold", placeholder="until released"),
        fields.RELEASE,
        *fields.POLICIES,
    ),
    figures=fields.MOTION,
    begins_held=True,
    from_present=True,
    arms=(1, 2),
    place=40,
)
