"""Calibrations and the model in use over REST."""

from typing import Annotated

from fastapi import APIRouter, Query, Response

from pincette.api.calibrations import CalibrationPlan, Proposal, ProposalAction, ProposalList
from pincette.api.jobs import Job
from pincette.api.problems import responses
from pincette_supervisor.jobs.refusals import require_job
from pincette_supervisor.kinds.bodies import CalibrationBody
from pincette_supervisor.rest.dependencies import (
    ADMIN,
    OBSERVE,
    OPERATE,
    AllRigs,
    Asking,
    IdempotencyKey,
)
from pincette_supervisor.rest.limits import LARGE
from pincette_supervisor.rest.routes_job_list import NAME_LENGTH
from pincette_supervisor.rest.routes_jobs import CREATED, DryRunQuery, Predict
from pincette_supervisor.rest.routes_jobs import create as create_job
from pincette_supervisor.rest.strict_route import StrictRoute

router = APIRouter(prefix="/calibrations", tags=["calibrations"], route_class=StrictRoute)


@router.post(
    "",
    openapi_extra=LARGE,
    status_code=201,
    response_model=Job | CalibrationPlan,
    responses=CREATED,
    dependencies=[OPERATE],
)
async def create(
    body: CalibrationBody,
    rigs: AllRigs,
    response: Response,
    asker: Asking,
    dry_run: DryRunQuery = False,
    predict: Predict = True,
    idempotency_key: IdempotencyKey = None,
) -> object:
    """Take a calibration: the same as a job of the kind ``calibrate``."""
    return await create_job(body, rigs, response, asker, dry_run, predict, idempotency_key)


@router.get("", responses=responses(404), dependencies=[OBSERVE])
def proposals(
    rigs: AllRigs,
    limit: Annotated[int, Query(ge=1, le=500)] = 50,
    rig: Annotated[str | None, Query(max_length=NAME_LENGTH)] = None,
    before: Annotated[
        str | None, Query(description="calibrations made before this one", max_length=NAME_LENGTH)
    ] = None,
) -> ProposalList:
    """What calibrations that succeeded propose, of every rig or of one, the newest first."""
    asked = rigs.all() if rig is None else [rigs.get(rig)]
    number = None if before is None else require_job(rigs.store, before).number
    found = [pair for one in asked for pair in one.calibrations.newest(limit + 1, number)]
    found.sort(key=lambda pair: pair[0], reverse=True)
    listed = [proposal for _, proposal in found[:limit]]
    more = len(found) > limit
    return ProposalList(calibrations=listed, next=listed[-1].id if more else None)


@router.get("/{calibration}", responses=responses(404), dependencies=[OBSERVE])
def proposal(calibration: str, rigs: AllRigs) -> Proposal:
    """One proposal beside what is in use; its name is that of its job."""
    return rigs.of_job(calibration).calibrations.one(calibration)


@router.post(
    "/{calibration}/actions",
    responses=responses(404, 409),
    dependencies=[ADMIN],
)
def act(calibration: str, body: ProposalAction, rigs: AllRigs, asker: Asking) -> Proposal:
    """Accept a proposal, which makes a version of the model and uses it, or discard it."""
    asker.note(body.type)
    manager = rigs.of_job(calibration)
    manager.claims.require(asker.claim)
    with manager.free():
        return manager.calibrations.act(calibration, body.type)
