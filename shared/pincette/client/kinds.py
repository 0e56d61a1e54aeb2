"""Which model a plan and a result are of, by the kind of job.

A kind that is installed at the supervisor alone is read by what all plans and results have; its
other members are there as they came.
"""

import httpx

from pincette.api.job_kinds import job_kinds
from pincette.api.jobs import Job
from pincette.api.plans import JobPlan
from pincette.api.results import JobResult
from pincette.client.call import model


def plan_of(answer: httpx.Response) -> JobPlan:
    """Read a plan of any kind, which a supervisor may have made of another one."""
    plan = JobPlan.model_validate_json(answer.content, extra="allow")
    known = job_kinds().get(plan.kind)
    return plan if known is None else model(known.plan)(answer)


def result_of(job: Job) -> JobResult | None:
    """The result of a job; None where it has not moved."""
    if job.result is None:
        return None
    known = job_kinds().get(job.kind)
    if known is None:
        return JobResult.model_validate(job.result, extra="allow")
    return known.result.model_validate(job.result, extra="ignore")
