"""Jobs over REST.

Plain functions run in a pool of threads, so that neither the store nor a slow program of the rig
holds up the event loop.
"""

import re
from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import AwareDatetime

from pincette.api.jobs import ActionRequest, Job, JobList
from pincette.api.plans import JobPlan
from pincette.api.problems import responses
from pincette.api.requests import LABEL_NAME, JobRequest
from pincette.api.states import JobState
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.tables import utc_text
from pincette_supervisor.kinds.bodies import AnyPlan, Body, KindName
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import (
    OBSERVE,
    OPERATE,
    AllRigs,
    HungUp,
    IdempotencyKey,
    IfNoneMatch,
    Note,
    Operator,
    etag,
    matched_revision,
)
from pincette_supervisor.rest.middleware import DRY_RUN
from pincette_supervisor.rest.strict_route import StrictRoute

WAIT_S, LONGEST_WAIT_S = 30.0, 60.0
REPLAYED = "Idempotency-Replayed"
NAME_LENGTH = 100
Predict = Annotated[
    bool,
    Query(
        description="play the plan on the model in use: a dry run says what it predicts, a job is "
        "refused for a limit that it breaks"
    ),
]
TAGGED: dict[str, Any] = {
    "ETag": {"description": "of the job's revision", "schema": {"type": "string"}}
}
CREATED: dict[int | str, dict[str, Any]] = {
    200: {
        "model": Job | AnyPlan,
        "description": "dry run: the plan, feasible or not; or the job that the Idempotency-Key "
        f"has created already, with the header {REPLAYED}",
    },
    201: {"model": Job, "description": "taken; Location names it"},
    **responses(404, 409, 422, 503),
}
"""Responses of the routes that create a job."""


def take(
    manager: JobManager,
    body: JobRequest,
    response: Response,
    *,
    dry_run: bool,
    by: str,
    note: Note,
    gone: HungUp,
    predict: bool = True,
    key: str | None = None,
) -> Job | JobPlan:
    """Take a job, or plan it only, and predict what playing the plan would come to."""
    note(DRY_RUN if dry_run or body.dry_run else body.kind)
    if dry_run or body.dry_run:
        response.status_code = 200
        planned = manager.plan(body)
        return (manager.predictions.predicted(planned) if predict else planned).plan
    try:
        job, replayed = manager.create(body, key, predict=predict, by=by, gone=gone)
    except ProblemError as error:
        if error.code == "caller-gone":
            note(f"{body.kind}: the caller hung up, nothing was begun")
        raise
    response.headers["Location"] = f"/api/v1/jobs/{job.id}"
    response.headers["ETag"] = etag(job.id, job.revision)
    if replayed:
        response.status_code = 200
        response.headers[REPLAYED] = "true"
    return job


def _label(text: str | None) -> tuple[str, str] | None:
    if text is None:
        return None
    name, equals, value = text.partition("=")
    if not equals or re.fullmatch(LABEL_NAME, name) is None:
        message = f"label = {text!r}: write name=value, as part=B7"
        raise ProblemError(
            422,
            "invalid-request",
            "The request cannot be used",
            message,
            errors=[{"parameter": "label", "message": message}],
        )
    return name, value


def _utc(name: str, time: datetime | None) -> str | None:
    if time is None:
        return None
    try:
        return utc_text(time)
    except OverflowError as error:  # within hours of the first or the last year
        message = f"{name} = {time}: beyond the years 1 to 9999 in UTC"
        raise ProblemError(
            422,
            "invalid-request",
            "The request cannot be used",
            message,
            errors=[{"parameter": name, "message": message}],
        ) from error


router = APIRouter(prefix="/jobs", tags=["jobs"], route_class=StrictRoute)


@router.post(
    "",
    status_code=201,
    response_model=Job | AnyPlan,
    responses=CREATED,
    dependencies=[OPERATE],
)
def create(
    body: Body,
    rigs: AllRigs,
    response: Response,
    by: Operator,
    note: Note,
    gone: HungUp,
    dry_run: Annotated[bool, Query(description="plan and predict only")] = False,
    predict: Predict = True,
    idempotency_key: IdempotencyKey = None,
) -> object:
    """Take a job, or with ``dry_run`` plan it only.

    With ``queue`` a job waits for those before it, where another one has the rig.
    """
    manager = rigs.of_request(body, idempotency_key)
    return take(
        manager,
        body,
        response,
        dry_run=dry_run,
        by=by,
        note=note,
        gone=gone,
        predict=predict,
        key=idempotency_key,
    )


@router.get("", responses=responses(404, 422), dependencies=[OBSERVE])
def jobs(
    rigs: AllRigs,
    limit: Annotated[int, Query(ge=1, le=500)] = 50,
    kind: KindName | None = None,
    state: JobState | None = None,
    rig: Annotated[str | None, Query(max_length=NAME_LENGTH)] = None,
    label: Annotated[str | None, Query(description="name=value", max_length=300)] = None,
    outcome: Annotated[
        str | None, Query(description="of the result, such as gripped", max_length=NAME_LENGTH)
    ] = None,
    text: Annotated[
        str | None,
        Query(
            description="part of the id, of a label, of the cause, or of who asked",
            min_length=1,
            max_length=NAME_LENGTH,
        ),
    ] = None,
    created_from: Annotated[
        AwareDatetime | None, Query(description="taken then or later, with a time zone")
    ] = None,
    created_to: Annotated[AwareDatetime | None, Query(description="taken before then")] = None,
    before: Annotated[
        str | None, Query(description="those taken before this job", max_length=NAME_LENGTH)
    ] = None,
) -> JobList:
    """Jobs, the newest first; those alone that are as named."""
    wanted = JobFilter(
        kind=kind,
        state=state,
        rig=rig,
        label=_label(label),
        outcome=outcome,
        text=text,
        created_from=_utc("created_from", created_from),
        created_to=_utc("created_to", created_to),
    )
    found = rigs.jobs(limit + 1, wanted, before)
    more = len(found) > limit
    return JobList(jobs=found[:limit], next=found[limit - 1].id if more else None)


@router.get(
    "/{job}",
    response_model=Job,
    dependencies=[OBSERVE],
    responses={
        200: {"headers": TAGGED},
        304: {"description": "the job still has the ETag that was sent", "headers": TAGGED},
        **responses(404, 422),
    },
)
async def job_state(
    job: str,
    rigs: AllRigs,
    response: Response,
    wait: Annotated[
        Literal["terminal", "change"] | None,
        Query(description="answer when the job has ended, or is not as it was"),
    ] = None,
    since: Annotated[
        int | None, Query(ge=0, description="with wait=change: the revision that is known")
    ] = None,
    timeout_s: Annotated[
        float,
        Query(ge=0, le=LONGEST_WAIT_S, allow_inf_nan=False, description="wait no longer"),
    ] = WAIT_S,
    if_none_match: IfNoneMatch = None,
) -> object:
    """One job.

    With ``wait`` the answer comes when it has ended (``terminal``), or when it is not as it
    was at the revision of ``since`` or of ``If-None-Match``, or without both as it is now
    (``change``), or in time as it is then. Progress alone is no change.
    """
    known = matched_revision(job, if_none_match) if since is None else since
    manager = rigs.with_live_job(job)
    if wait == "terminal":
        await manager.changes.wait(lambda: manager.is_over(job), timeout_s)
    elif wait == "change":
        if known is None:
            known = (await run_in_threadpool(rigs.job, job)).revision
        await manager.changes.wait(lambda: manager.changed_since(job, known), timeout_s)
    found = await run_in_threadpool(rigs.job, job)
    tag = etag(found.id, found.revision)
    if matched_revision(job, if_none_match) == found.revision:
        return Response(status_code=304, headers={"ETag": tag})
    response.headers["ETag"] = tag
    return found


@router.post(
    "/{job}/actions",
    status_code=202,
    dependencies=[OPERATE],
    responses={
        200: {"model": Job, "description": "what is asked for holds already"},
        **responses(404, 409, 422, 503),
    },
)
def act(
    job: str,
    body: ActionRequest,
    rigs: AllRigs,
    response: Response,
    by: Operator,
    note: Note,
) -> Job:
    """Start, pause, resume, stop, abort, release the part, or continue after a wait."""
    note(body.type)
    changed, holds = rigs.of_job(job).perform(job, body.type, by)
    response.headers["ETag"] = etag(changed.id, changed.revision)
    if holds:
        response.status_code = 200
    return changed
