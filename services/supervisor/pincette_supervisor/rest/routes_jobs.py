"""Jobs over REST, and the kinds of job and control laws that are installed.

Plain functions run in a pool of threads, so that neither the store nor a slow program of the rig
blocks the event loop.
"""

import asyncio
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import cache, partial
from typing import Annotated, Any, Literal, TypeVar, cast

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel

from pincette.api.job_kinds import job_kinds
from pincette.api.jobs import ActionRequest, Job, StoppedRequest, StopRequest
from pincette.api.kinds import KindList, described
from pincette.api.plans import JobPlan, LawList
from pincette.api.problems import responses
from pincette.api.requests import JobRequest
from pincette.api.states import STATES
from pincette.config.laws import described_laws
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.jobs.job_queue import ALWAYS
from pincette_supervisor.kinds.bodies import AnyPlan, Body
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.rest.dependencies import (
    OBSERVE,
    OPERATE,
    PROPOSE,
    SHARE,
    AllRigs,
    Asker,
    Asking,
    IdempotencyKey,
    IfNoneMatch,
    authorize,
    etag,
    matched_revision,
)
from pincette_supervisor.rest.limits import LARGE, SMALL_BYTES, read_body
from pincette_supervisor.rest.middleware import DRY_RUN
from pincette_supervisor.rest.strict_route import StrictRoute, parsed

M = TypeVar("M", bound=BaseModel)
WAIT_S, LONGEST_WAIT_S = 30.0, 60.0
STOP_THREADS = ThreadPoolExecutor(4, thread_name_prefix="stop-job")
"""Threads for stops of jobs. No rate limit rejects a stop, and no other request delays it."""
ACTION_THREADS = ThreadPoolExecutor(4, thread_name_prefix="act-on-job")
"""Threads for the other actions, such as a release; requests that read the journal do not use
them."""
DRY_RUN_THREADS = ThreadPoolExecutor(2, thread_name_prefix="dry-run")
"""Threads for dry runs: those that wait for a prediction leave the threads of all other requests
free, and at most two of them compute."""
REPLAYED = "Idempotency-Replayed"
DryRunQuery = Annotated[bool, Query(include_in_schema=False)]
"""Query parameter with the meaning of the request member ``dry_run``.

The documents name the member.
"""
Predict = Annotated[
    bool,
    Query(
        description=(
            "play the plan on the model in use: a dry run reports the prediction, a job that "
            "breaks a limit is refused"
        )
    ),
]
Curves = Annotated[
    bool,
    Query(description="with a dry run: false leaves the lists of `curves` and `prediction` empty"),
]
TAGGED: dict[str, Any] = {
    "ETag": {"description": "of the job's revision", "schema": {"type": "string"}}
}
CREATED: dict[int | str, dict[str, Any]] = {
    200: {
        "model": Job | AnyPlan,
        "description": "dry run: the plan, feasible or not; or the job that the Idempotency-Key "
        f"has created before, with the header {REPLAYED}",
    },
    201: {"model": Job, "description": "accepted; Location names it"},
    **responses(404, 409),
}
"""Responses of the routes that create a job."""


def take(
    manager: JobManager,
    body: JobRequest,
    response: Response,
    *,
    dry_run: bool,
    asker: Asker,
    predict: bool = True,
    curves: bool = True,
    key: str | None = None,
    jobs: str = "jobs",
) -> Job | JobPlan:
    """Create a job, or plan it only, and predict the result of the plan.

    ``jobs`` is the address of the jobs relative to that of the request. ``Location`` is relative,
    so that it is also correct below the path prefix of a reverse proxy.
    """
    proposes = "" if body.approval_s is None else "propose "
    asker.note(DRY_RUN if dry_run or body.dry_run else proposes + body.kind)
    if dry_run or body.dry_run:
        response.status_code = 200
        planned = manager.plan(body)
        plan = (manager.predictions.predicted(planned) if predict else planned).plan
        return plan if curves else _without_curves(plan)
    try:
        job, replayed = manager.create(
            body,
            key,
            predict=predict,
            by=asker.by,
            gone=asker.gone,
            claim=asker.claim,
            trace=asker.trace,
        )
    except ProblemError as error:
        if error.code == "caller-gone":
            asker.note(f"{body.kind}: the client closed the connection, nothing was started")
        raise
    response.headers["Location"] = f"{jobs}/{job.id}"
    response.headers["ETag"] = etag(job.id, job.revision)
    if replayed:
        response.status_code = 200
        response.headers[REPLAYED] = "true"
    return job


def _without_curves(plan: M) -> M:
    """Return a plan, or its prediction, with empty curves."""
    empty: dict[str, Any] = {}
    curves: BaseModel | None = getattr(plan, "curves", None)
    if curves is not None:
        empty["curves"] = curves.model_copy(update={name: [] for name in type(curves).model_fields})
    prediction: BaseModel | None = getattr(plan, "prediction", None)
    if prediction is not None:
        empty["prediction"] = _without_curves(prediction)
    return plan.model_copy(update=empty)


router = APIRouter(prefix="/jobs", tags=["jobs"], route_class=StrictRoute)


class CreationRoute(StrictRoute):
    """Route whose body determines the needed scope: a start needs more than a plan."""

    async def needed_by(self, request: Request, /) -> Collection[str]:
        """Return ``operate`` if the body would start a job."""
        with suppress(ProblemError):
            body: Any = parsed(await read_body(request, SMALL_BYTES))
            plans = request.query_params.get("dry_run") == "true"
            if isinstance(body, dict) and not plans:
                members = cast("dict[str, Any]", body)
                if not members.get("dry_run") and members.get("approval_s") is None:
                    return {"operate"}
        return ()


async def create(
    body: Body,
    request: Request,
    rigs: AllRigs,
    response: Response,
    asker: Asking,
    dry_run: DryRunQuery = False,
    predict: Predict = True,
    idempotency_key: IdempotencyKey = None,
    curves: Curves = True,
) -> object:
    """Create a job, or with ``dry_run`` plan it only.

    With ``queue``, a job waits for those before it if another one has the rig. With ``approval_s``,
    it is ``proposed`` until a person approves it. Without either of ``approval_s`` and ``dry_run``
    the scope `operate` is needed.
    """
    plans = dry_run or body.dry_run
    if not plans and body.approval_s is None:
        authorize(request, {"operate"})

    def taken() -> Job | JobPlan:
        return take(
            rigs.of_request(body, idempotency_key),
            body,
            response,
            dry_run=dry_run,
            asker=asker,
            predict=predict,
            curves=curves,
            key=idempotency_key,
        )

    if plans:
        return await asyncio.get_running_loop().run_in_executor(DRY_RUN_THREADS, taken)
    return await run_in_threadpool(taken)


router.add_api_route(
    "",
    create,
    methods=["POST"],
    openapi_extra=LARGE,
    status_code=201,
    response_model=Job | AnyPlan,
    responses=CREATED,
    dependencies=[PROPOSE],
    route_class_override=CreationRoute,
)


@router.post("/stop", dependencies=[OPERATE])
async def stop(body: StopRequest, rigs: AllRigs, asker: Asking) -> StoppedRequest:
    """Stop what an Idempotency-Key has started: its job, or a request that is still being planned.

    A later request with this key is rejected (409) as long as the supervisor runs.
    """
    asker.note(f"stop {body.idempotency_key}")
    loop = asyncio.get_running_loop()
    return await loop.run_in_executor(STOP_THREADS, _stopped, body, rigs, asker.by)


def _stopped(body: StopRequest, rigs: Rigs, by: str) -> StoppedRequest:
    key = body.idempotency_key
    for manager in rigs.all():
        # Checked before the locks: a request that waits for the disk holds its lock, but its job is
        # already recorded here.
        if (name := manager.turns.created(key)) is not None:
            return StoppedRequest(job=_stopped_job(manager, name, by))
    for manager in rigs.all():
        manager.turns.stop(key)
    known = rigs.store.created(key)
    if known is None:
        return StoppedRequest(job=None)
    return StoppedRequest(job=_stopped_job(rigs.of_job(known.job), known.job, by))


def _stopped_job(manager: JobManager, name: str, by: str) -> Job:
    job = manager.index.job(name)
    if not STATES[job.state].terminal:
        job, _ = manager.perform(job.id, "stop", by)
    return job


@router.get(
    "/{job}",
    response_model=Job,
    dependencies=[OBSERVE],
    responses={
        200: {"headers": TAGGED},
        304: {"description": "the job still has the ETag that was sent", "headers": TAGGED},
        **responses(404),
    },
)
async def job_state(
    job: str,
    rigs: AllRigs,
    response: Response,
    wait: Annotated[
        Literal["terminal", "recorded", "change"] | None,
        Query(
            description="answer when the job has ended, when its record is written as well, or "
            "when the job has changed"
        ),
    ] = None,
    since: Annotated[
        int | None, Query(ge=0, description="with wait=change: the revision that the client has")
    ] = None,
    timeout_s: Annotated[
        float,
        Query(ge=0, le=LONGEST_WAIT_S, allow_inf_nan=False, description="wait no longer"),
    ] = WAIT_S,
    if_none_match: IfNoneMatch = None,
) -> object:
    """Return one job.

    With ``wait`` the response comes once the job has ended (``terminal``), once its record is also
    written (``recorded``), or once the job has changed (``change``) since the revision of
    ``since`` or ``If-None-Match``, by default the present one. After ``timeout_s`` the job is
    returned in any case. Progress alone does not count as a change.
    """
    known = matched_revision(job, if_none_match) if since is None else since
    manager = rigs.with_live_job(job)
    found: Job | None = None
    if wait == "terminal":
        await manager.changes.wait(lambda: manager.index.is_over(job), timeout_s)
    elif wait == "recorded":
        await manager.changes.wait(lambda: manager.index.is_recorded(job), timeout_s)
    elif wait == "change":
        if known is None:
            found = await run_in_threadpool(rigs.job, job)
            known = found.revision
        if not manager.index.is_finished(job):
            found = None
            await manager.changes.wait(lambda: manager.index.changed_since(job, known), timeout_s)
    if found is None:
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
        200: {"model": Job, "description": "the job is already in the requested state"},
        **responses(404, 409),
    },
)
async def act(
    job: str,
    body: ActionRequest,
    rigs: AllRigs,
    request: Request,
    response: Response,
    asker: Asking,
) -> Job:
    """Start, pause, resume, stop or abort a job, release the part, or continue after a wait.

    A job in the state ``proposed`` is approved, planned again and queued or started; or rejected. A
    job in the state ``awaiting_recovery`` takes one of the decisions in its ``recovery``. After
    ``retry`` and ``retry_at``, ``ending.next_job`` names the job that repeats it.
    """
    asker.note(body.type)
    perform = partial(_performed, job, body, rigs, asker)
    if body.type in ALWAYS:
        loop = asyncio.get_running_loop()
        changed, holds = await loop.run_in_executor(STOP_THREADS, perform)
    else:
        limits: Callable[[], AbstractContextManager[None]] = request.scope.get(SHARE, nullcontext)
        with limits():
            loop = asyncio.get_running_loop()
            changed, holds = await loop.run_in_executor(ACTION_THREADS, perform)
    response.headers["ETag"] = etag(changed.id, changed.revision)
    if holds:
        response.status_code = 200
    return changed


def _performed(job: str, body: ActionRequest, rigs: Rigs, asker: Asker) -> tuple[Job, bool]:
    """Perform an action; the flag is True if nothing was left to do."""
    action = body.type
    manager = rigs.of_job(job)
    if action not in ALWAYS:
        manager.claims.require(asker.claim)
    changed, holds = manager.perform(job, action, asker.by, body.place)
    if action in ("approve", "reject"):
        asker.note(f"{action}, proposed by {changed.by}")
    return changed, holds


catalog_router = APIRouter(route_class=StrictRoute)


@cache
def _installed_kinds() -> KindList:
    """Describe every installed kind; their schemas are constant while the program runs."""
    return KindList(kinds=[described(kind) for kind in job_kinds().values()])


@catalog_router.get("/kinds", tags=["jobs"], dependencies=[OBSERVE])
def kinds() -> KindList:
    """Return every installed kind of job: its request, form, actions and results."""
    return _installed_kinds()


@catalog_router.get("/laws", tags=["laws"], dependencies=[OBSERVE])
def laws() -> LawList:
    """Return the control laws that a job may choose, each with its gains."""
    return LawList(laws=described_laws())
