"""Trajectories over REST: plan, check, foretell, keep, look at, and make jobs of them."""

from dataclasses import replace
from typing import Annotated, Any, cast

from fastapi import APIRouter, Query, Response

from pincette.api.job_models import Job
from pincette.api.motion_models import MotionPlan
from pincette.api.motion_requests import MoveJobRequest
from pincette.api.plan_models import Plan
from pincette.api.problem_models import responses
from pincette.api.trajectory_models import (
    Trajectory,
    TrajectoryBody,
    TrajectoryList,
    TrajectorySamples,
    TrajectoryStart,
    TrajectorySummary,
)
from pincette_supervisor.journal.trajectories import TrajectoryRow
from pincette_supervisor.planning.planned import Planned
from pincette_supervisor.rest.audited import DRY_RUN
from pincette_supervisor.rest.guard import OBSERVE, OPERATE, Note
from pincette_supervisor.rest.headers import Key, Who
from pincette_supervisor.rest.routes_jobs import take
from pincette_supervisor.rest.sample_formats import (
    COLUMNS,
    MEDIA_TYPES,
    Format,
    as_csv,
    as_parquet,
    table,
)
from pincette_supervisor.results.plan_plot import plan_png
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.kept_trajectories import KeptTrajectories
from pincette_supervisor.running.refusals import require_feasible
from pincette_supervisor.running.rigs import Rigs

PNG: dict[int | str, dict[str, Any]] = {
    200: {"content": {"image/png": {}}, "description": "a picture, 1400 by 1180 pixels"}
}
FORMATS: dict[int | str, dict[str, Any]] = {
    200: {
        "model": TrajectorySamples,
        "content": {media_type: {} for media_type in MEDIA_TYPES.values()},
        "description": "one sample each control period",
    }
}


def routes(rigs: Rigs) -> APIRouter:
    """Everything under ``/trajectories``."""
    router = APIRouter(prefix="/trajectories", tags=["trajectories"])

    def found(digest: str) -> tuple[Conductor, KeptTrajectories, TrajectoryRow]:
        """One that is kept, and the rig that it was made for."""
        row = KeptTrajectories(rigs.own.site).get(digest)
        conductor = rigs.of_row(row.rig)
        return conductor, KeptTrajectories(conductor.site), row

    def planned_anew(conductor: Conductor, body: TrajectoryBody) -> tuple[TrajectoryRow, Planned]:
        """Plan and foretell, from rest at the safe voltage, wherever the arm stands."""
        planned = replace(conductor.plan(body), present=None)
        kept = KeptTrajectories(conductor.site)
        row = kept.row_of(body)
        if isinstance(body, MoveJobRequest):
            planned = kept.require_planned(row)
        return row, conductor.foreteller.foretold(planned)

    @router.post(
        "",
        status_code=201,
        response_model=Trajectory | Plan | MotionPlan,
        dependencies=[OPERATE],
        responses={
            200: {
                "model": Trajectory | Plan | MotionPlan,
                "description": "known already; or dry run: the plan, feasible or not",
            },
            201: {"model": Trajectory, "description": "kept; Location names it"},
            **responses(404, 422, 503),
        },
    )
    def create(  # pyright: ignore[reportUnusedFunction]
        body: TrajectoryBody,
        response: Response,
        note: Note,
        dry_run: Annotated[bool, Query(description="keep nothing")] = False,
    ) -> object:
        """Plan a grip, a track or a move, foretell it, and keep it where it breaks no limit."""
        note(DRY_RUN if dry_run or body.dry_run else body.kind)
        conductor = rigs.chosen(body.rig)
        row, planned = planned_anew(conductor, body)
        if dry_run or body.dry_run:
            response.status_code = 200
            return planned.plan
        require_feasible(planned)
        row, anew = KeptTrajectories(conductor.site).book.add(row)
        response.headers["Location"] = f"/api/v1/trajectories/{row.digest}"
        if not anew:
            response.status_code = 200
        return _view(conductor, row, planned)

    @router.post(
        "/plot",
        response_class=Response,
        responses={**PNG, **responses(404, 422, 503)},
        dependencies=[OPERATE],
    )
    def plot_anew(  # pyright: ignore[reportUnusedFunction]
        body: TrajectoryBody, note: Note
    ) -> Response:
        """Draw the plan of a request, feasible or not; nothing is kept."""
        note(DRY_RUN)
        conductor = rigs.chosen(body.rig)
        _, planned = planned_anew(conductor, body)
        return _png(conductor, planned, "not kept")

    @router.get("", responses=responses(422), dependencies=[OBSERVE])
    def trajectories(  # pyright: ignore[reportUnusedFunction]
        limit: Annotated[int, Query(ge=1, le=500)] = 50,
    ) -> TrajectoryList:
        """Trajectories, the newest first."""
        newest = KeptTrajectories(rigs.own.site).book.newest(limit)
        return TrajectoryList(
            trajectories=[
                _summary(KeptTrajectories(rigs.of_row(row.rig).site), row) for row in newest
            ]
        )

    @router.get("/{digest}", responses=responses(404, 503), dependencies=[OBSERVE])
    def trajectory(digest: str) -> Trajectory:  # pyright: ignore[reportUnusedFunction]
        """One trajectory, planned and foretold with the model that it was made with."""
        conductor, kept, row = found(digest)
        planned = kept.planned(row)
        if planned is not None:
            planned = conductor.foreteller.foretold(planned)
        return _view(conductor, row, planned)

    @router.get(
        "/{digest}/samples",
        dependencies=[OBSERVE],
        response_model=None,
        responses={**FORMATS, **responses(404, 409, 422, 503)},
    )
    def samples(  # pyright: ignore[reportUnusedFunction]
        digest: str,
        form: Annotated[Format, Query(alias="format", description="of the answer")] = "json",
    ) -> TrajectorySamples | Response:
        """References, and what is foretold of position, force and voltage, sample by sample."""
        conductor, kept, row = found(digest)
        planned = kept.require_planned(row)
        rehearsal, rig = conductor.foreteller.rehearsal(planned), planned.model.rig
        if form == "json":
            return TrajectorySamples(
                digest=row.digest,
                period_s=rig.rig.period_s,
                cut=rehearsal.cut,
                columns=list(COLUMNS),
                samples=table(rehearsal.samples),
            )
        about = {
            "trajectory": row.digest,
            "rig": row.rig,
            "rig_file_digest": row.rig_file_digest,
            "model_digest": row.model_digest,
            "period_s": repr(rig.rig.period_s),
            "cut": rehearsal.cut,
        }
        content = (as_csv if form == "csv" else as_parquet)(rehearsal, about)
        name = f'attachment; filename="{row.digest}.{form}"'
        headers = {"Content-Disposition": name}
        return Response(content, media_type=MEDIA_TYPES[form], headers=headers)

    @router.get(
        "/{digest}/plot",
        dependencies=[OBSERVE],
        response_class=Response,
        responses={**PNG, **responses(404, 409, 503)},
    )
    def plot(digest: str) -> Response:  # pyright: ignore[reportUnusedFunction]
        """References, what is foretold, and the limits, as a picture."""
        conductor, kept, row = found(digest)
        planned = conductor.foreteller.foretold(kept.require_planned(row))
        return _png(conductor, planned, row.digest)

    @router.post(
        "/{digest}/jobs",
        dependencies=[OPERATE],
        status_code=201,
        response_model=Job,
        responses={
            200: {"model": Job, "description": "the job that the key has created already"},
            201: {"model": Job, "description": "taken; Location names it"},
            **responses(404, 409, 422, 503),
        },
    )
    def start(  # pyright: ignore[reportUnusedFunction]
        digest: str,
        response: Response,
        who: Who,
        note: Note,
        body: TrajectoryStart | None = None,
        idempotency_key: Key = None,
    ) -> object:
        """Take a job that does what the trajectory says, with rig file and model as they were."""
        conductor, kept, row = found(digest)
        request = kept.request(row, body or TrajectoryStart())
        return take(
            conductor, request, response, dry_run=False, by=who, note=note, key=idempotency_key
        )

    return router


def _summary(kept: KeptTrajectories, row: TrajectoryRow) -> TrajectorySummary:
    return TrajectorySummary(
        digest=row.digest,
        kind=row.request["kind"],
        rig=row.rig,
        request=row.request,
        created_at=row.created_at,
        stale=kept.stale(row),
    )


def _view(conductor: Conductor, row: TrajectoryRow, planned: Planned | None) -> Trajectory:
    summary = _summary(KeptTrajectories(conductor.site), row)
    rig = (planned.model if planned else conductor.site.model.in_use).rig
    played = conductor.foreteller.rehearsal(planned) if planned else None
    return Trajectory(
        **summary.model_dump(),
        values=planned.values if planned else {},
        period_s=rig.rig.period_s,
        samples=len(played.samples.t_s) if played else 0,
        plan=cast("Plan | MotionPlan", planned.plan) if planned else None,
    )


def _png(conductor: Conductor, planned: Planned, name: str) -> Response:
    rig = planned.model.rig
    drawn = plan_png(
        planned, conductor.foreteller.rehearsal(planned).samples, name=f"{rig.rig.name} · {name}"
    )
    return Response(drawn, media_type="image/png")
