"""Files of the records of jobs over REST."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from fastapi import APIRouter, Depends, Response
from fastapi.responses import FileResponse, StreamingResponse

from pincette.api.jobs import Artifact, ArtifactList
from pincette.api.problems import responses
from pincette.records import csv_export, finished_copy, folder, number_table
from pincette_supervisor import problems
from pincette_supervisor.jobs.job_index import WRITTEN_S
from pincette_supervisor.rest.dependencies import OBSERVE, AllRigs
from pincette_supervisor.rest.openapi import BINARY
from pincette_supervisor.rest.strict_route import StrictRoute

CSV = "samples.csv"
MADE: Mapping[str, tuple[str, Callable[[Path], Iterator[str | bytes]], str]] = {
    CSV: (folder.SAMPLES, csv_export.csv_rows, csv_export.MEDIA_TYPE),
    csv_export.NUMBERS: (folder.SAMPLES, csv_export.number_rows, csv_export.MEDIA_TYPE),
    f"{csv_export.NUMBERS}{number_table.METADATA}": (
        folder.SAMPLES,
        csv_export.number_metadata,
        number_table.MEDIA_TYPE,
    ),
    finished_copy.NAME: (folder.LIVE, finished_copy.snapshot, folder.MEDIA_TYPES[folder.LIVE]),
}
"""Files that are made as they are downloaded: the file each is made of, how, and its media type."""


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
    """One file of a job's record. Some are made of others as they go.

    ``samples.csv`` is made of ``samples.parquet``, and so is ``numbers.csv``, which has numbers
    alone; ``numbers.csv-metadata.json`` describes it. ``snapshot.mcap`` is a finished copy of
    ``job.mcap`` as it is now.
    """
    known = rigs.job(job)
    path = rigs.records(known.rig) / known.id / name
    made = {one: path.with_name(of) for one, (of, _, _) in MADE.items()}
    if name in MADE and made[name].is_file():
        _, make, media_type = MADE[name]
        shown = f"{known.id}.csv" if name == CSV else name
        attached = {"Content-Disposition": f'attachment; filename="{shown}"'}
        return StreamingResponse(make(made[name]), media_type=media_type, headers=attached)
    media_type = folder.media_type(name)
    if media_type is None or not path.is_file():
        there = [entry["name"] for entry in folder.artifacts(path.parent)]
        if not there:
            raise problems.not_found("artifact", name, why=f"job {known.id} has no record")
        more = [one for one, of in made.items() if of.is_file()]
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
