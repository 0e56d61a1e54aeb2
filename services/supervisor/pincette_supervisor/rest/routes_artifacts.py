"""Files of the records of jobs over REST."""

from fastapi import APIRouter, Depends, Response
from fastapi.responses import FileResponse, StreamingResponse

from pincette.api.jobs import Artifact, ArtifactList
from pincette.api.problems import responses
from pincette.records import csv_export, folder
from pincette_supervisor import problems
from pincette_supervisor.jobs.job_index import WRITTEN_S
from pincette_supervisor.rest.dependencies import OBSERVE, AllRigs
from pincette_supervisor.rest.openapi import BINARY
from pincette_supervisor.rest.strict_route import StrictRoute

CSV = "samples.csv"


async def _written(job: str, rigs: AllRigs) -> None:
    manager = rigs.with_live_job(job)
    await manager.changes.wait(
        lambda: manager.index.is_recorded(job) or not manager.index.is_over(job), WRITTEN_S
    )


WRITTEN = Depends(_written)
router = APIRouter(prefix="/jobs", tags=["jobs"], route_class=StrictRoute)


@router.get("/{job}/artifacts", responses=responses(404), dependencies=[OBSERVE, WRITTEN])
def artifacts(job: str, rigs: AllRigs) -> ArtifactList:
    """Files of a job's record, with size and SHA-256; waits while they are being written."""
    known = rigs.job(job)
    found = folder.artifacts(rigs.records(known.rig) / known.id)
    return ArtifactList(artifacts=[Artifact(**entry) for entry in found])


@router.get(
    "/{job}/artifacts/{name}",
    response_model=None,
    response_class=FileResponse,
    responses=responses(404),
    dependencies=[OBSERVE, WRITTEN],
)
def artifact(job: str, name: str, rigs: AllRigs) -> Response:
    """One file of a job's record; ``samples.csv`` is made of ``samples.parquet`` as it goes."""
    known = rigs.job(job)
    path = rigs.records(known.rig) / known.id / name
    samples = path.with_name(folder.SAMPLES)
    if name == CSV and samples.is_file():
        attached = {"Content-Disposition": f'attachment; filename="{known.id}.csv"'}
        rows = csv_export.csv_rows(samples)
        return StreamingResponse(rows, media_type=csv_export.MEDIA_TYPE, headers=attached)
    media_type = folder.media_type(name)
    if media_type is None or not path.is_file():
        there = [entry["name"] for entry in folder.artifacts(path.parent)]
        if not there:
            raise problems.not_found("artifact", name, why=f"job {known.id} has no record")
        more = [CSV] if samples.is_file() else []
        raise problems.not_found("artifact", name, [*there, *more])
    return FileResponse(path, media_type=media_type, filename=name)


@router.get(
    "/{job}/artifacts/{name}/content",
    response_class=Response,
    responses={
        200: {"description": "the bytes of the file, whatever its kind", "content": BINARY},
        **responses(404),
    },
    dependencies=[OBSERVE, WRITTEN],
)
def artifact_content(job: str, name: str, rigs: AllRigs) -> Response:
    """One file of a job's record as bytes, for clients that are generated from this document."""
    response = artifact(job, name, rigs)
    (response.headers["Content-Type"],) = BINARY
    return response
