"""``release``: release the part in the gripper."""

from typing import Literal

from pincette.api import example
from pincette.api.job_kinds import JobKind
from pincette.api.plans import MotionPlan
from pincette.api.requests import Duration, JobRequest
from pincette.api.results import MotionResult
from pincette_supervisor.kinds import fields


class ReleaseJobRequest(JobRequest, frozen=True):
    """Let go what is in the gripper: a smooth way from the voltage applied to the safe voltage.

    Until its end the part counts as held: a fault on the way freezes the voltage first.
    """

    model_config = example(kind="release", autostart=True, release_s=2.0)

    kind: Literal["release"]
    release_s: Duration | None = None
    """Left out, as long as a grip takes to unload, or as the slew limit asks for."""


KIND = JobKind(
    name="release",
    label="Release a part",
    summary="Let go of what is in the gripper.",
    request=ReleaseJobRequest,
    plan=MotionPlan,
    result=MotionResult,
    functions="pincette_supervisor.kinds.release.functions:FUNCTIONS",
    form=(fields.RELEASE,),
    figures=fields.MOTION,
    begins_held=True,
    from_present=True,
    arms=(1, 2),
    place=50,
)
