"""Jobs of the past over REST: lists, tables, descriptions, and files of their records."""

import json
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response
from fastapi.responses import FileResponse
from pydantic import AwareDatetime

from pincette.api.jobs import Artifact, ArtifactList, Job, JobEdit, JobList
from pincette.api.problems import responses
from pincette.api.requests import LABEL_NAME
from pincette.api.states import JobState
from pincette.records import csv_export, finished_copy, folder, number_table
from pincette_supervisor import problems
from pincette_supervisor.jobs.job_index import WRITTEN_S
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.tables import utc_text
from pincette_supervisor.kinds.bodies import KindName
from pincette_supervisor.rest.dependencies import (
    ADMIN,
    BINARY,
    CSV,
    NAME_LENGTH,
    OBJECT,
    OBSERVE,
    OPERATE,
    AllRigs,
    Content,
    Named,
    Note,
    Operator,
    PageSize,
    etag,
)
from pincette_supervisor.rest.download import Download
from pincette_supervisor.rest.limits import LARGE
from pincette_supervisor.rest.strict_route import JSON, StrictRoute
from pincette_supervisor.results import job_table


def _label(text: str | None) -> tuple[str, str] | None:
    if text is None:
        return None
    name, _, value = text.partition("=")
    return name, value


def _utc(name: str, time: datetime | None) -> str | None:
    if time is None:
        return None
    try:
        return utc_text(time)
    except OverflowError as error:  # within hours of the first or the last year
        message = f"{name} = {time}: must be in the years 1 to 9999 in UTC"
        raise problems.unusable(message, parameter=name) from error


async def _filter(
    kind: KindName | None = None,
    state: JobState | None = None,
    rig: Named = None,
    label: Annotated[
        str | None,
        Query(description="name=value", pattern=LABEL_NAME.replace("$", "="), max_length=300),
    ] = None,
    outcome: Annotated[
        str | None,
        Query(description="outcome in the result, such as gripped", max_length=NAME_LENGTH),
    ] = None,
    sample: Named = None,
    batch: Named = None,
    operator: Named = None,
    pinned: bool | None = None,
    text: Annotated[
        str | None,
        Query(
            description=(
                "part of the id, of sample, batch, operator, notes or a label, of the cause, or "
                "of the name of the requester"
            ),
            min_length=1,
            max_length=NAME_LENGTH,
        ),
    ] = None,
    created_from: Annotated[
        AwareDatetime | None, Query(description="accepted at this time or later, with a time zone")
    ] = None,
    created_to: Annotated[
        AwareDatetime | None, Query(description="accepted before this time")
    ] = None,
) -> JobFilter:
    return JobFilter(
        kind=kind,
        state=state,
        rig=rig,
        label=_label(label),
        outcome=outcome,
        sample=sample,
        batch=batch,
        operator=operator,
        pinned=pinned,
        text=text,
        created_from=_utc("created_from", created_from),
        created_to=_utc("created_to", created_to),
    )


Wanted = Annotated[JobFilter, Depends(_filter)]
"""Filter of a list of jobs."""

TABLE = "one row for each job with its labels, request and results; units are in the names"
NUMBERS = (
    "one row for each job, as numbers: 1 for yes, 0 for no, nan for none, times in seconds "
    "since 1970"
)
METADATA = "metadata in CSVW; save it under the name of the table with -metadata.json appended"
NUMBERS_CSV = "export.numbers.csv"
MostJobs = Annotated[
    int | None, Query(ge=1, description="only this many of the newest jobs; all by default")
]

SAMPLES_CSV = "samples.csv"
MADE: Mapping[str, tuple[str, Callable[[Path], Iterator[str | bytes]], str]] = {
    SAMPLES_CSV: (folder.SAMPLES, csv_export.csv_rows, csv_export.MEDIA_TYPE),
    csv_export.NUMBERS: (folder.SAMPLES, csv_export.number_rows, csv_export.MEDIA_TYPE),
    f"{csv_export.NUMBERS}{number_table.METADATA}": (
        folder.SAMPLES,
        csv_export.number_metadata,
        number_table.MEDIA_TYPE,
    ),
    finished_copy.NAME: (folder.LIVE, finished_copy.snapshot, folder.MEDIA_TYPES[folder.LIVE]),
}
"""Files that are generated during the download, each with its source file, generator and media
type."""


async def _written(job: str, rigs: AllRigs) -> None:
    manager = rigs.with_live_job(job)
    await manager.changes.wait(
        lambda: manager.index.is_recorded(job) or not manager.index.is_over(job), WRITTEN_S
    )


WRITTEN = Depends(_written)
router = APIRouter(prefix="/jobs", tags=["jobs"], route_class=StrictRoute)


@router.get("", response_model=JobList, responses=responses(404), dependencies=[OBSERVE])
def jobs(
    rigs: AllRigs,
    wanted: Wanted,
    limit: PageSize = 50,
    before: Annotated[
        str | None, Query(description="jobs accepted before this one", max_length=NAME_LENGTH)
    ] = None,
) -> Response:
    """Return jobs, newest first; only those that match the filter."""
    found = rigs.listed_jobs(limit + 1, wanted, before)
    names = list(found)
    following = names[limit - 1] if len(names) > limit else None
    jobs = b",".join(found[name] for name in names[:limit])
    content = b'{"jobs":[%b],"next":%b}' % (jobs, json.dumps(following).encode())
    return Response(content, media_type=JSON)


@router.get(
    "/export.csv",
    response_class=Response,
    responses={200: {"description": TABLE, "content": CSV}, **responses(404)},
    dependencies=[OBSERVE],
)
def export_csv(rigs: AllRigs, wanted: Wanted, limit: MostJobs = None) -> Response:
    """Return jobs as one CSV table, newest first; only those that match the filter."""
    return _attached(job_table.csv_of(rigs.table_rows(wanted, limit)), CSV, "jobs.csv")


@router.get(
    "/export.parquet",
    response_class=Response,
    responses={200: {"description": TABLE, "content": BINARY}, **responses(404)},
    dependencies=[OBSERVE],
)
def export_parquet(rigs: AllRigs, wanted: Wanted, limit: MostJobs = None) -> Response:
    """Return jobs as one Parquet table, newest first; only those that match the filter."""
    return _attached(job_table.parquet_of(rigs.table_rows(wanted, limit)), BINARY, "jobs.parquet")


@router.get(
    "/export.numbers.csv",
    response_class=Response,
    responses={200: {"description": NUMBERS, "content": CSV}, **responses(404)},
    dependencies=[OBSERVE],
)
def export_numbers(rigs: AllRigs, wanted: Wanted, limit: MostJobs = None) -> Response:
    """Return jobs as one table of numbers only, newest first; only those that match the filter."""
    return _attached(job_table.numbers_of(rigs.table_rows(wanted, limit)), CSV, NUMBERS_CSV)


@router.get(
    "/export.numbers.csv-metadata.json",
    response_class=Response,
    responses={200: {"description": METADATA, "content": OBJECT}, **responses(404)},
    dependencies=[OBSERVE],
)
def export_metadata(rigs: AllRigs, wanted: Wanted, limit: MostJobs = None) -> Response:
    """Return the columns of the table of numbers, with the word that each number represents."""
    parts = job_table.metadata_of(rigs.table_rows(wanted, limit), NUMBERS_CSV)
    return _attached(parts, OBJECT, f"{NUMBERS_CSV}{number_table.METADATA}")


def _attached(parts: Iterator[bytes], content: Content, name: str) -> Response:
    (media_type,) = content
    return Download(parts, media_type, name)


@router.patch(
    "/{job}",
    openapi_extra=LARGE,
    responses=responses(404),
    dependencies=[OPERATE],
)
def edit(
    job: str, body: JobEdit, rigs: AllRigs, response: Response, by: Operator, note: Note
) -> Job:
    """Edit a job's sample, batch, operator, notes, labels and pin, at any time.

    Report and manifest of its record are updated; files of samples stay as they are.
    """
    note(", ".join(sorted(body.model_fields_set)))
    edited = rigs.of_job(job).index.edit(job, body, by)
    response.headers["ETag"] = etag(edited.id, edited.revision)
    return edited


@router.delete("/{job}/record", responses=responses(404, 409), dependencies=[ADMIN, WRITTEN])
def delete_record(job: str, rigs: AllRigs, by: Operator, note: Note) -> Job:
    """Delete the files of an ended job that is not pinned; its result is kept."""
    note(f"record of {job}")
    return rigs.of_job(job).index.delete_record(job, by)


@router.get("/{job}/artifacts", responses=responses(404), dependencies=[OBSERVE, WRITTEN])
def artifacts(job: str, rigs: AllRigs) -> ArtifactList:
    """Return the files of a job's record, with size and SHA-256.

    Waits while they are being written.
    """
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
    """Return one file of a job's record. Some files are generated from others.

    ``samples.csv`` is generated from ``samples.parquet``, and so is ``numbers.csv``, which contains
    only numbers; ``numbers.csv-metadata.json`` describes it. ``snapshot.mcap`` is a finished copy
    of the present ``job.mcap``.
    """
    known = rigs.job(job)
    path = rigs.records(known.rig) / known.id / name
    made = {one: path.with_name(of) for one, (of, _, _) in MADE.items()}
    if name in MADE and made[name].is_file():
        _, make, media_type = MADE[name]
        shown = f"{known.id}.csv" if name == SAMPLES_CSV else name
        return Download(make(made[name]), media_type, shown)
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
    """Return one file of a job's record as bytes, for clients generated from this document."""
    response = artifact(job, name, rigs)
    (response.headers["Content-Type"],) = BINARY
    return response
