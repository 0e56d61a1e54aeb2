"""Jobs over REST.

Plain functions run in a pool of threads, so that neither the store nor a slow program of the rig
holds up the event loop.
"""

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse

from pincette.api.calibration_models import CalibrationPlan
from pincette.api.job_models import (
    ActionRequest,
    Artifact,
    ArtifactList,
    Job,
    JobList,
)
from pincette.api.plan_models import Plan
from pincette.api.problem_models import responses
from pincette.api.request_models import AnyJobRequest, Body
from pincette.records import folder
from pincette_supervisor import problems
from pincette_supervisor.running.conductor import Conductor

WAIT_S, LONGEST_WAIT_S = 30.0, 60.0


def take(
    conductor: Conductor, body: AnyJobRequest, response: Response, *, dry_run: bool
) -> Job | Plan | CalibrationPlan:
    """Take a job, or plan it only."""
    if dry_run or body.dry_run:
        response.status_code = 200
        return conductor.plan(body).plan
    job = conductor.submit(body)
    response.headers["Location"] = f"/api/v1/jobs/{job.id}"
    return job


def routes(conductor: Conductor) -> APIRouter:
    """Everything under ``/jobs``."""
    router = APIRouter(prefix="/jobs", tags=["jobs"])

    @router.post(
        "",
        status_code=201,
        response_model=Job | Plan | CalibrationPlan,
        responses={
            200: {
                "model": Plan | CalibrationPlan,
                "description": "dry run: the plan, feasible or not",
            },
            201: {"model": Job, "description": "taken; Location names it"},
            **responses(404, 409, 422, 503),
        },
    )
    def create(  # pyright: ignore[reportUnusedFunction]
        body: Body,
        response: Response,
        dry_run: Annotated[bool, Query(description="plan and predict only")] = False,
    ) -> object:
        """Take a job, or with ``dry_run`` plan it only."""
        return take(conductor, body, response, dry_run=dry_run)

    @router.get("", responses=responses(422))
    def jobs(  # pyright: ignore[reportUnusedFunction]
        limit: Annotated[int, Query(ge=1, le=500)] = 50,
    ) -> JobList:
        """Jobs, the newest first."""
        return JobList(jobs=conductor.jobs(limit))

    @router.get("/{job}", responses=responses(404, 422))
    async def job_state(  # pyright: ignore[reportUnusedFunction]
        job: str,
        wait: Annotated[
            Literal["terminal"] | None, Query(description="answer when the job has ended")
        ] = None,
        timeout_s: Annotated[
            float,
            Query(ge=0, le=LONGEST_WAIT_S, allow_inf_nan=False, description="wait no longer"),
        ] = WAIT_S,
    ) -> Job:
        """One job; with ``wait`` the answer comes when it has ended, or in time as it is then."""
        if wait is not None:
            await conductor.changes.wait(lambda: conductor.over(job), timeout_s)
        return await run_in_threadpool(conductor.job, job)

    @router.post(
        "/{job}/actions",
        status_code=202,
        responses={
            200: {"model": Job, "description": "what is asked for holds already"},
            **responses(404, 409, 422, 503),
        },
    )
    def act(  # pyright: ignore[reportUnusedFunction]
        job: str, body: ActionRequest, request: Request, response: Response
    ) -> Job:
        """Start, stop, abort, release the part, or continue where the job waits for a person."""
        by = request.client.host if request.client is not None else "unknown"
        changed, holds = conductor.act(job, body.type, by)
        if holds:
            response.status_code = 200
        return changed

    @router.get("/{job}/artifacts", responses=responses(404))
    def artifacts(job: str) -> ArtifactList:  # pyright: ignore[reportUnusedFunction]
        """Files of a job's record, with size and SHA-256."""
        known = conductor.job(job)
        found = folder.artifacts(conductor.site.records / known.id)
        return ArtifactList(artifacts=[Artifact(**entry) for entry in found])

    @router.get("/{job}/artifacts/{name}", responses=responses(404), response_class=FileResponse)
    def artifact(job: str, name: str) -> FileResponse:  # pyright: ignore[reportUnusedFunction]
        """One file of a job's record."""
        known = conductor.job(job)
        path = conductor.site.records / known.id / name
        if name not in folder.MEDIA_TYPES or not path.is_file():
            raise problems.not_found("artifact", name, list(folder.MEDIA_TYPES))
        return FileResponse(path, media_type=folder.MEDIA_TYPES[name], filename=name)

    return router
