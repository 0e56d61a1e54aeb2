"""Models of plans and results, by the kind of job.

If a kind is installed only at the supervisor, only the members that all plans or results have are
validated; the others are kept as received.
"""

from typing import cast

import httpx
from pydantic import TypeAdapter

from pincette.api.job_kinds import job_kinds, union
from pincette.api.jobs import Job
from pincette.api.plans import JobPlan
from pincette.api.results import JobResult


def plan_of(answer: httpx.Response) -> JobPlan:
    """Parse a plan by the kind that it states; members of an unknown kind are kept as received."""
    plan = JobPlan.model_validate_json(answer.content, extra="allow")
    known = job_kinds().get(plan.kind)
    if known is None:
        return plan
    return cast(
        "JobPlan", TypeAdapter(union(known.plans)).validate_json(answer.content, extra="ignore")
    )


def result_of(job: Job) -> JobResult | None:
    """Return the result of a job; None if the job has not moved."""
    if job.result is None:
        return None
    known = job_kinds().get(job.kind)
    if known is None:
        return JobResult.model_validate(job.result, extra="allow")
    return cast(
        "JobResult", TypeAdapter(union(known.results)).validate_python(job.result, extra="ignore")
    )
