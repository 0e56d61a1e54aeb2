"""Which model a plan and a result are of, by the kind of job.

A kind that is installed at the supervisor alone is read by what all plans and results have.
"""

from pincette.api.job_kinds import job_kinds
from pincette.api.jobs import Job
from pincette.api.plans import JobPlan
from pincette.api.results import JobResult


def plan_model(kind: str) -> type[JobPlan]:
    """The model of a plan."""
    known = job_kinds().get(kind)
    return JobPlan if known is None else known.plan


def result_of(job: Job) -> JobResult | None:
    """The result of a job; None where it has not moved."""
    if job.result is None:
        return None
    known = job_kinds().get(job.kind)
    if known is None:
        return JobResult.model_validate(job.result, extra="allow")
    return known.result.model_validate(job.result, extra="ignore")
