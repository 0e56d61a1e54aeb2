"""Trajectories over REST: plan, check, predict, store, display, and start them as jobs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, cast

from fastapi import APIRouter, Depends, Query, Response

from pincette.api.jobs import Job
from pincette.api.pairs import PairPlan
from pincette.api.plans import MotionPlan, Plan
from pincette.api.problems import responses
from pincette.api.trajectories import (
    Trajectory,
    TrajectoryList,
    TrajectorySamples,
    TrajectoryStart,
    TrajectorySummary,
)
from pincette_supervisor import problems
from pincette_supervisor.jobs import planner
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.jobs.planner import TrajectoryStore
from pincette_supervisor.jobs.refusals import require_feasible
from pincette_supervisor.journal.library import TrajectoryRow
from pincette_supervisor.kinds.bodies import TrajectoryBody
from pincette_supervisor.planning.dry_run import DryRun
from pincette_supervisor.planning.predicted_samples import (
    Samples,
    as_csv,
    as_parquet,
    columns_of,
    table,
)
from pincette_supervisor.plugin import Planned
from pincette_supervisor.rest.dependencies import (
    BINARY,
    CSV,
    NAME_LENGTH,
    OBSERVE,
    OPERATE,
    PNG,
    PROPOSE,
    AllRigs,
    Asking,
    Content,
    IdempotencyKey,
    Note,
    PageSize,
)
from pincette_supervisor.rest.limits import LARGE
from pincette_supervisor.rest.middleware import DRY_RUN
from pincette_supervisor.rest.routes_jobs import DryRunQuery, take
from pincette_supervisor.rest.strict_route import StrictRoute
from pincette_supervisor.results.plan_plot import plan_png

PICTURE: dict[int | str, dict[str, Any]] = {
    200: {"content": PNG, "description": "a picture, 1400 by 1180 pixels"}
}
SAMPLES = "one sample each control period"


@dataclass(frozen=True, slots=True)
class Stored:
    """A stored trajectory, and the rig for which it was planned."""

    manager: JobManager
    store: TrajectoryStore
    row: TrajectoryRow


def _stored(digest: str, rigs: AllRigs) -> Stored:
    row = TrajectoryStore(rigs.own.context).get(digest)
    manager = rigs.of_row(row.rig)
    return Stored(manager, TrajectoryStore(manager.context), row)


StoredTrajectory = Annotated[Stored, Depends(_stored)]

router = APIRouter(prefix="/trajectories", tags=["trajectories"], route_class=StrictRoute)


@router.post(
    "",
    openapi_extra=LARGE,
    status_code=201,
    response_model=Trajectory | Plan | PairPlan | MotionPlan,
    dependencies=[OPERATE],
    responses={
        200: {
            "model": Trajectory | Plan | PairPlan | MotionPlan,
            "description": "exists already; or dry run: the plan, feasible or not",
        },
        201: {"model": Trajectory, "description": "stored; Location names it"},
        **responses(404),
    },
)
def create(
    body: TrajectoryBody,
    rigs: AllRigs,
    response: Response,
    note: Note,
    dry_run: DryRunQuery = False,
) -> object:
    """Plan a grip, a track or a move, predict it, and store it if it exceeds no limit."""
    note(DRY_RUN if dry_run or body.dry_run else body.kind)
    manager = rigs.select(body.rig)
    row, planned = _planned_from_rest(manager, body)
    if dry_run or body.dry_run:
        response.status_code = 200
        return planned.plan
    require_feasible(planned)
    row, is_new = TrajectoryStore(manager.context).book.add(row)
    response.headers["Location"] = f"trajectories/{row.digest}"
    if not is_new:
        response.status_code = 200
    return _view(manager, row, planned)


@router.post(
    "/plot",
    openapi_extra=LARGE,
    response_class=Response,
    responses={**PICTURE, **responses(404)},
    dependencies=[PROPOSE],
)
def plot_request(body: TrajectoryBody, rigs: AllRigs, note: Note) -> Response:
    """Draw the plan of a request, feasible or not; nothing is stored."""
    note(DRY_RUN)
    manager = rigs.select(body.rig)
    _, planned = _planned_from_rest(manager, body)
    return _png(manager, planned, "not stored")


@router.get("", responses=responses(404), dependencies=[OBSERVE])
def trajectories(
    rigs: AllRigs,
    limit: PageSize = 50,
    before: Annotated[
        str | None, Query(description="trajectories after this digest", max_length=NAME_LENGTH)
    ] = None,
) -> TrajectoryList:
    """Return trajectories, newest first."""
    book = TrajectoryStore(rigs.own.context).book
    after = None if before is None else book.get(before)
    if before is not None and after is None:
        raise problems.not_found("trajectory", before)
    newest = book.newest(limit + 1, after)
    return TrajectoryList(
        trajectories=[
            _summary(TrajectoryStore(rigs.of_row(row.rig).context), row) for row in newest[:limit]
        ],
        next=newest[limit - 1].digest if len(newest) > limit else None,
    )


@router.get("/{digest}", responses=responses(404), dependencies=[OBSERVE])
def trajectory(stored: StoredTrajectory) -> Trajectory:
    """Return one trajectory, as planned and predicted with its model."""
    manager = stored.manager
    planned = stored.store.planned(stored.row)
    if planned is not None:
        planned = manager.predictions.predicted(planned)
    return _view(manager, stored.row, planned)


@router.get(
    "/{digest}/samples",
    dependencies=[OBSERVE],
    responses={200: {"description": SAMPLES}, **responses(404, 409)},
)
def samples(stored: StoredTrajectory) -> TrajectorySamples:
    """Return the references and the predicted position, force and voltage of each sample."""
    planned, dry_run = _played(stored)
    return TrajectorySamples(
        digest=stored.row.digest,
        period_s=planned.model.rig.rig.period_s,
        cut=dry_run.cut,
        columns=list(columns_of(dry_run.samples)),
        samples=table(dry_run.samples),
    )


@router.get(
    "/{digest}/samples.csv",
    dependencies=[OBSERVE],
    response_class=Response,
    responses={200: {"description": SAMPLES, "content": CSV}, **responses(404, 409)},
)
def samples_csv(stored: StoredTrajectory) -> Response:
    """Return the samples as CSV, after comments that name the columns with their units."""
    return _file(stored, as_csv, CSV, "csv")


@router.get(
    "/{digest}/samples.parquet",
    dependencies=[OBSERVE],
    response_class=Response,
    responses={200: {"description": SAMPLES, "content": BINARY}, **responses(404, 409)},
)
def samples_parquet(stored: StoredTrajectory) -> Response:
    """Return the samples as Parquet, with the units of the columns in its metadata."""
    return _file(stored, as_parquet, BINARY, "parquet")


def _played(stored: Stored) -> tuple[Planned, DryRun]:
    planned = stored.store.require_planned(stored.row)
    return planned, stored.manager.predictions.dry_run(planned)


def _file(
    stored: Stored,
    encode: Callable[[Samples, dict[str, str]], bytes],
    content: Content,
    suffix: str,
) -> Response:
    row, (planned, dry_run) = stored.row, _played(stored)
    about = {
        "trajectory": row.digest,
        "rig": row.rig,
        "rig_file_digest": row.rig_file_digest,
        "model_digest": row.model_digest,
        "period_s": repr(planned.model.rig.rig.period_s),
        "cut": dry_run.cut,
    }
    (media_type,) = content
    headers = {"Content-Disposition": f'attachment; filename="{row.digest}.{suffix}"'}
    return Response(encode(dry_run.samples, about), media_type=media_type, headers=headers)


@router.get(
    "/{digest}/plot",
    dependencies=[OBSERVE],
    response_class=Response,
    responses={**PICTURE, **responses(404, 409)},
)
def plot(stored: StoredTrajectory) -> Response:
    """Return a picture of the references, the prediction and the limits."""
    planned = stored.manager.predictions.predicted(stored.store.require_planned(stored.row))
    return _png(stored.manager, planned, stored.row.digest)


@router.post(
    "/{digest}/jobs",
    openapi_extra=LARGE,
    dependencies=[OPERATE],
    status_code=201,
    response_model=Job,
    responses={
        200: {"model": Job, "description": "the job that the key has already created"},
        201: {"model": Job, "description": "accepted; Location names it"},
        **responses(404, 409),
    },
)
def start(
    stored: StoredTrajectory,
    response: Response,
    asker: Asking,
    body: TrajectoryStart | None = None,
    idempotency_key: IdempotencyKey = None,
) -> object:
    """Create a job that follows the trajectory, with the rig file and model of its planning."""
    request = stored.store.request(stored.row, body or TrajectoryStart())
    return take(
        stored.manager,
        request,
        response,
        dry_run=False,
        asker=asker,
        key=idempotency_key,
        jobs="../../jobs",
    )


def _planned_from_rest(manager: JobManager, body: TrajectoryBody) -> tuple[TrajectoryRow, Planned]:
    """Plan and predict from rest at the safe voltage, regardless of the arm's position."""
    resolved = replace(manager.resolve(body), present=None)
    row = TrajectoryStore(manager.context).row_of(resolved)
    return row, manager.predictions.predicted(planner.plan(manager.context, resolved))


def _summary(store: TrajectoryStore, row: TrajectoryRow) -> TrajectorySummary:
    return TrajectorySummary(
        digest=row.digest,
        kind=row.request["kind"],
        rig=row.rig,
        request=row.request,
        created_at=row.created_at,
        stale=store.stale(row),
    )


def _view(manager: JobManager, row: TrajectoryRow, planned: Planned | None) -> Trajectory:
    summary = _summary(TrajectoryStore(manager.context), row)
    rig = (planned.model if planned else manager.context.model.in_use).rig
    played = manager.predictions.dry_run(planned) if planned else None
    return Trajectory(
        **summary.model_dump(),
        values=planned.values if planned else {},
        period_s=rig.rig.period_s,
        samples=len(played.samples.t_s) if played else 0,
        plan=cast("Plan | PairPlan | MotionPlan", planned.plan) if planned else None,
    )


def _png(manager: JobManager, planned: Planned, name: str) -> Response:
    draw = partial(plan_png, planned, name=f"{planned.model.rig.rig.name} · {name}")
    drawn = manager.context.draw(draw, manager.predictions.dry_run(planned).samples)
    return Response(drawn, media_type="image/png")
