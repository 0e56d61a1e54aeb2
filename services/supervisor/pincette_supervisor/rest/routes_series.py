"""Series over REST: one request for many jobs, its actions, its report and its figure."""

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from pincette.api.problems import responses
from pincette.api.series import Series, SeriesAction, SeriesList, SeriesPlan, SeriesRequest
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.jobs.series import SeriesRunner, require_series
from pincette_supervisor.journal.series import SeriesRepository
from pincette_supervisor.rest.dependencies import (
    NAME_LENGTH,
    OBSERVE,
    OPERATE,
    SHARE,
    AllRigs,
    Asker,
    Asking,
    Content,
    IdempotencyKey,
    Named,
    PageSize,
)
from pincette_supervisor.rest.limits import LARGE
from pincette_supervisor.rest.middleware import DRY_RUN
from pincette_supervisor.rest.routes_jobs import (
    ACTION_THREADS,
    DRY_RUN_THREADS,
    LONGEST_WAIT_S,
    REPLAYED,
    STOP_THREADS,
    WAIT_S,
)
from pincette_supervisor.rest.routes_trajectories import PICTURE
from pincette_supervisor.rest.strict_route import StrictRoute
from pincette_supervisor.results.series_report import SeriesReport, drawn, report

HTML: Content = {"text/html; charset=utf-8": {"schema": {"type": "string"}}}
router = APIRouter(prefix="/series", tags=["series"], route_class=StrictRoute)


def _runner(series: str, rigs: Rigs) -> SeriesRunner:
    """Return the runner of the rig of a series; raises ProblemError without the series."""
    return rigs.of_row(require_series(SeriesRepository(rigs.store), series).rig).series


@router.post(
    "",
    openapi_extra=LARGE,
    status_code=201,
    response_model=Series | SeriesPlan,
    responses={
        200: {
            "model": Series | SeriesPlan,
            "description": "dry run: the plan of all jobs; or the series that the Idempotency-Key "
            f"has created before, with the header {REPLAYED}",
        },
        201: {"model": Series, "description": "running; Location names it"},
        **responses(404, 409),
    },
    dependencies=[OPERATE],
)
async def create(
    body: SeriesRequest,
    rigs: AllRigs,
    response: Response,
    asker: Asking,
    idempotency_key: IdempotencyKey = None,
) -> object:
    """Create a series and start it, or with ``dry_run`` plan and predict its jobs only.

    All jobs are planned first: nothing moves if one of them cannot be done. Each job is predicted
    before it starts, as any job is.
    """
    call = partial(_created, body, rigs, response, asker, idempotency_key)
    # Planning many jobs takes seconds, so it uses none of the threads of other requests.
    return await asyncio.get_running_loop().run_in_executor(DRY_RUN_THREADS, call)


def _created(
    body: SeriesRequest, rigs: Rigs, response: Response, asker: Asker, key: str | None
) -> Series | SeriesPlan:
    known = None if key is None else SeriesRepository(rigs.store).created(key)
    runner = (rigs.select(body.rig) if known is None else rigs.of_row(known.rig)).series
    asker.note(DRY_RUN if body.dry_run else f"series {body.name}".rstrip())
    if body.dry_run:
        response.status_code = 200
        return runner.plan(body)
    series, replayed = runner.create(body, key, by=asker.by, claim=asker.claim, trace=asker.trace)
    response.headers["Location"] = f"series/{series.id}"
    if replayed:
        response.status_code = 200
        response.headers[REPLAYED] = "true"
    return series


@router.get("", responses=responses(404), dependencies=[OBSERVE])
def series_list(
    rigs: AllRigs,
    rig: Named = None,
    limit: PageSize = 50,
    before: Annotated[
        str | None, Query(description="series created before this one", max_length=NAME_LENGTH)
    ] = None,
) -> SeriesList:
    """Return series, newest first."""
    repository = SeriesRepository(rigs.store)
    number = None if before is None else require_series(repository, before).number
    rows = repository.newest(limit + 1, rig=rig, before=number)
    return SeriesList(
        series=[rigs.of_row(row.rig).series.summary(row) for row in rows[:limit]],
        next=rows[limit - 1].id if len(rows) > limit else None,
    )


@router.get("/{series}", responses=responses(404), dependencies=[OBSERVE])
async def series_state(
    series: str,
    rigs: AllRigs,
    wait: Annotated[
        Literal["over"] | None,
        Query(description="answer when the series is not running, but in time as it is then"),
    ] = None,
    timeout_s: Annotated[
        float,
        Query(ge=0, le=LONGEST_WAIT_S, allow_inf_nan=False, description="wait no longer"),
    ] = WAIT_S,
) -> Series:
    """Return one series with its jobs.

    The jobs are ordinary jobs with the label ``series=ID``: lists and tables of jobs take it as a
    filter.
    """
    runner = await run_in_threadpool(_runner, series, rigs)
    if wait is not None:
        await runner.wait_over(series, timeout_s)
    return await run_in_threadpool(lambda: runner.view(runner.find(series)))


@router.post(
    "/{series}/actions",
    status_code=202,
    dependencies=[OPERATE],
    responses={
        200: {"model": Series, "description": "the requested state holds already"},
        **responses(404, 409),
    },
)
async def act(
    series: str,
    body: SeriesAction,
    rigs: AllRigs,
    request: Request,
    response: Response,
    asker: Asking,
) -> Series:
    """Pause, resume or stop a series."""
    asker.note(body.type)
    perform = partial(_performed, series, body, rigs, asker)
    loop = asyncio.get_running_loop()
    if body.type == "stop":
        changed, holds = await loop.run_in_executor(STOP_THREADS, perform)
    else:
        limits: Callable[[], AbstractContextManager[None]] = request.scope.get(SHARE, nullcontext)
        with limits():
            changed, holds = await loop.run_in_executor(ACTION_THREADS, perform)
    if holds:
        response.status_code = 200
    return changed


def _performed(series: str, body: SeriesAction, rigs: Rigs, asker: Asker) -> tuple[Series, bool]:
    row = require_series(SeriesRepository(rigs.store), series)
    return rigs.get(row.rig).series.perform(series, body.type, by=asker.by, claim=asker.claim)


def _report(series: str, rigs: Rigs) -> tuple[SeriesReport, bytes]:
    """Return the content of a report, and its figure."""
    runner = _runner(series, rigs)
    view = runner.view(runner.find(series))
    rows = rigs.store.several([one.job for one in view.jobs if one.job is not None])
    content = SeriesReport.of(view, rows)
    return content, rigs.own.context.draw(drawn, content)


@router.get(
    "/{series}/report",
    response_class=Response,
    responses={
        200: {"description": "an HTML page that needs no other file", "content": HTML},
        **responses(404),
    },
    dependencies=[OBSERVE],
)
def series_report(series: str, rigs: AllRigs) -> Response:
    """Return the report of a series: its figure, its verdicts, and a table of its jobs."""
    content, picture = _report(series, rigs)
    headers = {"Content-Disposition": f'attachment; filename="series-{content.series.id}.html"'}
    (media_type,) = HTML
    return Response(report(content, picture), media_type=media_type, headers=headers)


@router.get(
    "/{series}/plot",
    response_class=Response,
    responses={**PICTURE, **responses(404)},
    dependencies=[OBSERVE],
)
def plot(series: str, rigs: AllRigs) -> Response:
    """Return the figure: the force held over the requested force, with U and the verdicts."""
    return Response(_report(series, rigs)[1], media_type="image/png")
