"""Which model a plan and a result are of, by the kind of job."""

from collections.abc import Mapping

from pincette.api.calibration_models import CalibrationPlan, CalibrationResult
from pincette.api.job_models import Job, JobKind
from pincette.api.motion_models import MotionPlan
from pincette.api.plan_models import Plan
from pincette.api.result_models import GripResult, MotionResult, TrackResult

AnyPlan = Plan | MotionPlan | CalibrationPlan
PLANS: Mapping[str, type[AnyPlan]] = {
    "grip": Plan,
    "track": Plan,
    "move": MotionPlan,
    "hold": MotionPlan,
    "release": MotionPlan,
    "calibrate": CalibrationPlan,
}
AnyResult = GripResult | TrackResult | MotionResult | CalibrationResult
RESULTS: Mapping[JobKind, type[AnyResult]] = {
    "grip": GripResult,
    "track": TrackResult,
    "move": MotionResult,
    "hold": MotionResult,
    "release": MotionResult,
    "calibrate": CalibrationResult,
}


def result_of(job: Job) -> AnyResult | None:
    """The result of a job; None where it has not moved."""
    if job.result is None:
        return None
    return RESULTS[job.kind].model_validate(job.result, extra="ignore")
